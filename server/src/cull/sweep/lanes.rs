//! Eight numbers at a time. The only place that knows of SIMD.
//!
//! [`Plain`] runs everywhere; on x86 with AVX2 the same operations run on vectors. Both round after every operation and
//! give the same bits.

use crate::tree::WideNode;

/// Eight `f32` side by side.
pub(super) trait Lanes: Copy {
    /// Eight numbers.
    type Wide: Copy;
    /// A number for each axis, and a fourth that nobody reads.
    type Axes: Copy;
    /// Eight unsigned integers.
    type Words: Copy;

    /// Runs a kernel compiled for these lanes.
    fn run<K: Kernel>(self, kernel: K) -> K::Output;
    /// A node's origin moved by `offset`, rounded once, and halves of its steps, metres.
    fn place(self, node: &WideNode, offset: &[f64; 4]) -> [Self::Axes; 2];
    /// Along each axis, the greatest distance of what begins at `offset` and is `half_steps` times `half_step_m` long.
    fn reach(self, offset: Self::Axes, half_step_m: Self::Axes, half_steps: f32) -> [f32; 3];
    /// Of each axis, its number eight times.
    fn spread(self, axes: Self::Axes) -> [Self::Wide; 3];
    /// As numbers.
    fn to_three(self, axes: Self::Axes) -> [f32; 3];
    /// The same number eight times.
    fn splat(self, value: f32) -> Self::Wide;
    /// Bytes as numbers.
    fn widen(self, bytes: &[u8; 8]) -> Self::Wide;
    /// Signed bytes as numbers.
    fn widen_signed(self, bytes: &[i8; 8]) -> Self::Wide;
    /// a + b
    fn add(self, a: Self::Wide, b: Self::Wide) -> Self::Wide;
    /// a − b
    fn sub(self, a: Self::Wide, b: Self::Wide) -> Self::Wide;
    /// a · b
    fn mul(self, a: Self::Wide, b: Self::Wide) -> Self::Wide;
    /// A bit for each lane in which a < b.
    fn below(self, a: Self::Wide, b: Self::Wide) -> u8;
    /// A bit for each lane with a sign.
    fn negative(self, a: Self::Wide) -> u8;
    /// The lesser of a and b.
    fn min(self, a: Self::Wide, b: Self::Wide) -> Self::Wide;
    /// a without its sign.
    fn abs(self, a: Self::Wide) -> Self::Wide;
    /// As numbers.
    fn to_array(self, a: Self::Wide) -> [f32; 8];
    /// A bit for each word in which bit `bit` is set.
    fn with_bit(self, words: &[u32; 8], bit: u32) -> u8;
    /// Eight words.
    fn words(self, words: &[u32; 8]) -> Self::Words;
    /// Words, none greater than `most`.
    fn at_most(self, words: Self::Words, most: u32) -> Self::Words;
    /// In each lane the word of the next one, in the last one `last`.
    fn next(self, words: Self::Words, last: u32) -> Self::Words;
    /// The same word eight times.
    fn repeat(self, word: u32) -> Self::Words;
    /// `yes` in the lanes whose bits are set, `no` in the others.
    fn choose(self, bits: u8, yes: Self::Words, no: Self::Words) -> Self::Words;
    /// Writes the words whose bits are set side by side, in order; what comes behind them in `out` is anything.
    fn pack(self, words: Self::Words, bits: u8, out: &mut [u32; 8]);
    /// Bit `word − first` of each word, modulo 64.
    fn marks(self, words: Self::Words, first: u32) -> u64;
    /// The bits of `bits`, from the lowest, in the places where `places` has ones, from the lowest.
    fn deposit(self, bits: u64, places: u64) -> u64;
    /// Asks for the memory of something that is soon looked at.
    fn prefetch<T>(self, soon: &T);
    /// The same for an element, or for nothing where there is none: a hint, which costs no branch.
    fn prefetch_at<T>(self, list: &[T], at: usize);
}

/// What runs on lanes. Everything that it calls with them must be `#[inline(always)]`, and no closure may use them: what
/// the compiler leaves a function of its own is compiled for any processor, and calls every instruction.
pub(super) trait Kernel {
    /// What comes out.
    type Output;
    /// Runs it.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Runs a kernel on the best lanes of this machine.
pub(super) fn run_on_best<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = avx2::Avx2::detect() {
        return avx2.run(kernel);
    }
    Plain.run(kernel)
}

/// One number after the other.
#[derive(Clone, Copy)]
pub(super) struct Plain;

impl Lanes for Plain {
    type Wide = [f32; 8];
    type Axes = [f32; 3];
    type Words = [u32; 8];

    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }

    #[inline(always)]
    fn place(self, node: &WideNode, offset: &[f64; 4]) -> [[f32; 3]; 2] {
        let moved = std::array::from_fn(|axis| (offset[axis] + f64::from(node.origin[axis])) as f32);
        [moved, node.step_m().map(|step_m| step_m * 0.5)]
    }

    #[inline(always)]
    fn reach(self, offset: [f32; 3], half_step_m: [f32; 3], half_steps: f32) -> [f32; 3] {
        std::array::from_fn(|axis| offset[axis].abs() + half_steps * half_step_m[axis])
    }

    #[inline(always)]
    fn spread(self, axes: [f32; 3]) -> [[f32; 8]; 3] {
        axes.map(|number| [number; 8])
    }

    #[inline(always)]
    fn to_three(self, axes: [f32; 3]) -> [f32; 3] {
        axes
    }

    #[inline(always)]
    fn splat(self, value: f32) -> [f32; 8] {
        [value; 8]
    }

    #[inline(always)]
    fn widen(self, bytes: &[u8; 8]) -> [f32; 8] {
        bytes.map(f32::from)
    }

    #[inline(always)]
    fn widen_signed(self, bytes: &[i8; 8]) -> [f32; 8] {
        bytes.map(f32::from)
    }

    #[inline(always)]
    fn add(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] + b[i])
    }

    #[inline(always)]
    fn sub(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] - b[i])
    }

    #[inline(always)]
    fn mul(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] * b[i])
    }

    #[inline(always)]
    fn below(self, a: [f32; 8], b: [f32; 8]) -> u8 {
        (0..8).fold(0, |mask, i| mask | (u8::from(a[i] < b[i]) << i))
    }

    #[inline(always)]
    fn negative(self, a: [f32; 8]) -> u8 {
        (0..8).fold(0, |mask, i| mask | (u8::from(a[i].is_sign_negative()) << i))
    }

    #[inline(always)]
    fn min(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }

    #[inline(always)]
    fn abs(self, a: [f32; 8]) -> [f32; 8] {
        a.map(f32::abs)
    }

    #[inline(always)]
    fn to_array(self, a: [f32; 8]) -> [f32; 8] {
        a
    }

    #[inline(always)]
    fn with_bit(self, words: &[u32; 8], bit: u32) -> u8 {
        (0..8).fold(0, |mask, i| mask | (((words[i] >> bit) & 1) as u8) << i)
    }

    #[inline(always)]
    fn words(self, words: &[u32; 8]) -> [u32; 8] {
        *words
    }

    #[inline(always)]
    fn at_most(self, words: [u32; 8], most: u32) -> [u32; 8] {
        words.map(|word| word.min(most))
    }

    #[inline(always)]
    fn next(self, words: [u32; 8], last: u32) -> [u32; 8] {
        std::array::from_fn(|i| if i < 7 { words[i + 1] } else { last })
    }

    #[inline(always)]
    fn repeat(self, word: u32) -> [u32; 8] {
        [word; 8]
    }

    #[inline(always)]
    fn choose(self, bits: u8, yes: [u32; 8], no: [u32; 8]) -> [u32; 8] {
        std::array::from_fn(|i| if (bits >> i) & 1 != 0 { yes[i] } else { no[i] })
    }

    #[inline(always)]
    fn pack(self, words: [u32; 8], bits: u8, out: &mut [u32; 8]) {
        let mut count = 0;
        for (lane, word) in words.into_iter().enumerate() {
            out[count % 8] = word;
            count += usize::from((bits >> lane) & 1);
        }
    }

    #[inline(always)]
    fn marks(self, words: [u32; 8], first: u32) -> u64 {
        words.into_iter().fold(0, |marks, word| marks | 1u64.wrapping_shl(word.wrapping_sub(first)))
    }

    #[inline(always)]
    fn deposit(self, mut bits: u64, mut places: u64) -> u64 {
        let mut deposited = 0;
        while places != 0 {
            let place = places & places.wrapping_neg();
            deposited |= if bits & 1 != 0 { place } else { 0 };
            (bits, places) = (bits >> 1, places ^ place);
        }
        deposited
    }

    #[inline(always)]
    fn prefetch<T>(self, _: &T) {}

    #[inline(always)]
    fn prefetch_at<T>(self, _: &[T], _: usize) {}
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)] // vector instructions; each is sound where the processor has them, which `Avx2` proves
mod avx2 {
    use super::{Kernel, Lanes};
    use crate::tree::WideNode;
    use std::arch::x86_64::*;
    use std::mem::offset_of;

    /// A processor with AVX2 and what came with it: there is no other way to one than [`Avx2::detect`].
    #[derive(Clone, Copy)]
    pub(in crate::cull::sweep) struct Avx2(());

    impl Avx2 {
        /// AVX2, where this machine has it.
        pub fn detect() -> Option<Self> {
            let has_all = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            has_all.then_some(Self(()))
        }
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    fn compiled_for_avx2<K: Kernel>(lanes: Avx2, kernel: K) -> K::Output {
        kernel.run(lanes)
    }

    impl Lanes for Avx2 {
        type Wide = __m256;
        type Axes = __m128;
        type Words = __m256i;

        #[inline(always)]
        fn run<K: Kernel>(self, kernel: K) -> K::Output {
            // SAFETY: the processor has AVX2: `self` was made after asking it.
            unsafe { compiled_for_avx2(self, kernel) }
        }

        #[inline(always)]
        fn place(self, node: &WideNode, offset: &[f64; 4]) -> [__m128; 2] {
            // Behind the three numbers of the origin stand the exponents, a byte each, and another byte.
            const EXPONENT: usize = offset_of!(WideNode, exponent);
            const { assert!(EXPONENT == offset_of!(WideNode, origin) + 12 && EXPONENT + 4 <= size_of::<WideNode>()) }
            // A step's bits are its exponent's, and half of it has one less.
            const HALF: i32 = 126 << 23;
            // SAFETY: as above; the loads read sixteen and four bytes of the node, all of them numbers whatever they are, and the
            // offset's four numbers.
            unsafe {
                let start = std::ptr::from_ref(node).cast::<u8>();
                let origin = _mm_loadu_ps(start.add(offset_of!(WideNode, origin)).cast());
                // What is no number of three becomes zero, as it may be slow to count with.
                let origin = _mm_insert_ps::<0b1000>(origin, origin);
                let moved = _mm256_add_pd(_mm256_cvtps_pd(origin), _mm256_loadu_pd(offset.as_ptr()));
                let exponents = _mm_cvtepi8_epi32(_mm_loadu_si32(start.add(EXPONENT)));
                let half_step_m = _mm_add_epi32(_mm_slli_epi32::<23>(exponents), _mm_set1_epi32(HALF));
                [_mm256_cvtpd_ps(moved), _mm_castsi128_ps(half_step_m)]
            }
        }

        #[inline(always)]
        fn reach(self, offset: __m128, half_step_m: __m128, half_steps: f32) -> [f32; 3] {
            // SAFETY: as above.
            let reach = unsafe {
                let distance = _mm_andnot_ps(_mm_set1_ps(-0.0), offset);
                _mm_add_ps(distance, _mm_mul_ps(_mm_set1_ps(half_steps), half_step_m))
            };
            self.to_three(reach)
        }

        #[inline(always)]
        fn spread(self, axes: __m128) -> [__m256; 3] {
            // SAFETY: as above.
            unsafe {
                let twice = _mm256_set_m128(axes, axes);
                [
                    _mm256_permute_ps::<0b00_00_00_00>(twice),
                    _mm256_permute_ps::<0b01_01_01_01>(twice),
                    _mm256_permute_ps::<0b10_10_10_10>(twice),
                ]
            }
        }

        #[inline(always)]
        fn to_three(self, axes: __m128) -> [f32; 3] {
            // SAFETY: both are four numbers side by side.
            let [x, y, z, _] = unsafe { std::mem::transmute::<__m128, [f32; 4]>(axes) };
            [x, y, z]
        }

        #[inline(always)]
        fn splat(self, value: f32) -> __m256 {
            // SAFETY: as above.
            unsafe { _mm256_set1_ps(value) }
        }

        #[inline(always)]
        fn widen(self, bytes: &[u8; 8]) -> __m256 {
            let low = i64::from_le_bytes(*bytes);
            // SAFETY: as above.
            unsafe { _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(low))) }
        }

        #[inline(always)]
        fn widen_signed(self, bytes: &[i8; 8]) -> __m256 {
            let low = i64::from_le_bytes(bytes.map(i8::cast_unsigned));
            // SAFETY: as above.
            unsafe { _mm256_cvtepi32_ps(_mm256_cvtepi8_epi32(_mm_cvtsi64_si128(low))) }
        }

        #[inline(always)]
        fn add(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: as above.
            unsafe { _mm256_add_ps(a, b) }
        }

        #[inline(always)]
        fn sub(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: as above.
            unsafe { _mm256_sub_ps(a, b) }
        }

        #[inline(always)]
        fn mul(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: as above.
            unsafe { _mm256_mul_ps(a, b) }
        }

        #[inline(always)]
        fn below(self, a: __m256, b: __m256) -> u8 {
            // SAFETY: as above.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)) as u8 }
        }

        #[inline(always)]
        fn negative(self, a: __m256) -> u8 {
            // SAFETY: as above.
            unsafe { _mm256_movemask_ps(a) as u8 }
        }

        #[inline(always)]
        fn min(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: as above.
            unsafe { _mm256_min_ps(a, b) }
        }

        #[inline(always)]
        fn abs(self, a: __m256) -> __m256 {
            // SAFETY: as above.
            unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a) }
        }

        #[inline(always)]
        fn to_array(self, a: __m256) -> [f32; 8] {
            // SAFETY: both are eight numbers side by side.
            unsafe { std::mem::transmute::<__m256, [f32; 8]>(a) }
        }

        #[inline(always)]
        fn with_bit(self, words: &[u32; 8], bit: u32) -> u8 {
            // SAFETY: as above; the load reads the eight words, wherever they stand.
            unsafe {
                let words = _mm256_loadu_si256(words.as_ptr().cast());
                let signs = _mm256_sll_epi32(words, _mm_cvtsi32_si128(31 - bit as i32));
                _mm256_movemask_ps(_mm256_castsi256_ps(signs)) as u8
            }
        }

        #[inline(always)]
        fn words(self, words: &[u32; 8]) -> __m256i {
            // SAFETY: as above; the load reads the eight words, wherever they stand.
            unsafe { _mm256_loadu_si256(words.as_ptr().cast()) }
        }

        #[inline(always)]
        fn at_most(self, words: __m256i, most: u32) -> __m256i {
            // SAFETY: as above.
            unsafe { _mm256_min_epu32(words, _mm256_set1_epi32(most.cast_signed())) }
        }

        #[inline(always)]
        fn next(self, words: __m256i, last: u32) -> __m256i {
            // SAFETY: as above.
            unsafe {
                let moved = _mm256_permutevar8x32_epi32(words, _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7));
                _mm256_blend_epi32::<0x80>(moved, _mm256_set1_epi32(last.cast_signed()))
            }
        }

        #[inline(always)]
        fn repeat(self, word: u32) -> __m256i {
            // SAFETY: as above.
            unsafe { _mm256_set1_epi32(word.cast_signed()) }
        }

        #[inline(always)]
        fn choose(self, bits: u8, yes: __m256i, no: __m256i) -> __m256i {
            // SAFETY: as above.
            unsafe {
                let lanes = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let set = _mm256_and_si256(_mm256_set1_epi32(bits.into()), lanes);
                _mm256_blendv_epi8(no, yes, _mm256_cmpeq_epi32(set, lanes))
            }
        }

        #[inline(always)]
        fn pack(self, words: __m256i, bits: u8, out: &mut [u32; 8]) {
            // SAFETY: as above; the store writes the eight words of `out`, wherever they stand.
            unsafe {
                let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(PACKED[usize::from(bits)].cast_signed()));
                _mm256_storeu_si256(out.as_mut_ptr().cast(), _mm256_permutevar8x32_epi32(words, order));
            }
        }

        #[inline(always)]
        fn marks(self, words: __m256i, first: u32) -> u64 {
            // SAFETY: as above.
            unsafe {
                let places = _mm256_sub_epi32(words, _mm256_set1_epi32(first.cast_signed()));
                let places = _mm256_and_si256(places, _mm256_set1_epi32(63));
                let one = _mm256_set1_epi64x(1);
                let low = _mm256_sllv_epi64(one, _mm256_cvtepu32_epi64(_mm256_castsi256_si128(places)));
                let high = _mm256_sllv_epi64(one, _mm256_cvtepu32_epi64(_mm256_extracti128_si256::<1>(places)));
                let marks = _mm256_or_si256(low, high);
                let marks = _mm_or_si128(_mm256_castsi256_si128(marks), _mm256_extracti128_si256::<1>(marks));
                (_mm_cvtsi128_si64(marks) | _mm_extract_epi64::<1>(marks)).cast_unsigned()
            }
        }

        #[inline(always)]
        fn deposit(self, bits: u64, places: u64) -> u64 {
            // SAFETY: as above: BMI2 came with it.
            unsafe { _pdep_u64(bits, places) }
        }

        #[inline(always)]
        fn prefetch<T>(self, soon: &T) {
            self.prefetch_at(std::slice::from_ref(soon), 0);
        }

        #[inline(always)]
        fn prefetch_at<T>(self, list: &[T], at: usize) {
            const LINE: usize = 64;
            let start = list.as_ptr().wrapping_add(at).cast::<i8>();
            for offset in (0..size_of::<T>()).step_by(LINE) {
                // SAFETY: a hint, which reads nothing, whatever the address.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(offset)) }
            }
        }
    }

    /// Of each mask, its lanes in order, a byte each.
    const PACKED: [u64; 256] = {
        let mut packed = [0; 256];
        let mut bits = 0;
        while bits < 256 {
            let (mut lane, mut count) = (0, 0);
            while lane < 8 {
                if bits >> lane & 1 != 0 {
                    packed[bits] |= lane << (8 * count);
                    count += 1;
                }
                lane += 1;
            }
            bits += 1;
        }
        packed
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All operations on awkward numbers, as bits.
    struct Everything;

    impl Kernel for Everything {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Vec<u32> {
            let numbers = [0.0, -0.0, 1.0, 3.0e-39, f32::MAX, f32::INFINITY, f32::NAN, 0.1, -7.3, 1.0 / 3.0];
            let bytes = l.widen(&[0, 1, 2, 127, 128, 200, 254, 255]);
            let signed = l.widen_signed(&[0, 1, -1, 127, -127, -128, 64, -3]);
            let words = [0, 1 << 30, 1 << 31, u32::MAX, 7, 1 << 29, 3 << 30, 1];
            let mut bits: Vec<u32> = [0, 2, 30, 31].map(|bit| u32::from(l.with_bit(&words, bit))).to_vec();
            let next = l.next(l.at_most(l.words(&words), 3 << 30), 35);
            for mask in 0..=255u8 {
                let mut packed = [0; 8];
                l.pack(l.choose(mask >> 3, next, l.repeat(9)), mask, &mut packed);
                bits.extend_from_slice(&packed[..mask.count_ones() as usize]);
                let deposited = l.deposit(mask.into(), 0x8100_0420_0180_1021);
                bits.extend([deposited as u32, (deposited >> 32) as u32]);
            }
            for first in [0, 7, 8, (1 << 29) - 63, (1 << 29) - 64, u32::MAX] {
                let marks = l.marks(next, first);
                bits.extend([marks as u32, (marks >> 32) as u32]);
            }
            for exponent in [[0, 3, -3], [-30, 7, 30]] {
                let node = WideNode { origin: [3.3, -0.7e6, 1e-3], exponent, ..WideNode::default() };
                let [offset, half_step_m] = l.place(&node, &[0.1, 0.7e6, -1e7, 1.0]);
                bits.extend(l.to_three(offset).map(f32::to_bits));
                bits.extend(l.reach(offset, half_step_m, 510.0).map(f32::to_bits));
                bits.extend(l.spread(half_step_m).into_iter().flat_map(|wide| l.to_array(wide)).map(f32::to_bits));
            }
            for a in numbers {
                for b in numbers {
                    let (wide_a, wide_b) = (l.mul(l.splat(a), bytes), l.splat(b));
                    let product = l.mul(wide_a, wide_b);
                    for x in [
                        l.add(signed, wide_b),
                        l.add(wide_a, wide_b),
                        l.sub(wide_a, wide_b),
                        product,
                        l.add(product, wide_a),
                        l.min(l.abs(wide_a), wide_b),
                    ] {
                        // One NaN is as good as another.
                        for number in l.to_array(x) {
                            bits.push(if number.is_nan() { u32::MAX } else { number.to_bits() });
                        }
                        bits.push(u32::from(l.below(x, wide_a)) | u32::from(l.below(wide_b, x)) << 8);
                        // NaNs may differ in their signs.
                        bits.push(u32::from(l.negative(l.min(x, l.splat(0.0)))));
                    }
                }
            }
            bits
        }
    }

    #[test]
    fn vectors_and_plain_numbers_agree_to_the_bit() {
        assert_eq!(run_on_best(Everything), Plain.run(Everything));
    }
}
