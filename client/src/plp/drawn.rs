//! Which triangles an estimate holds: a bit for each, so that a triangle that many cells hold is drawn once.

use mullion_common::scene::Tessellation;

const BITS: u32 = u64::BITS;

/// Triangles by slot.
#[derive(Debug, Default)]
pub struct Drawn {
    bits: Vec<u64>,
    /// By the leaf's place in the tessellation.
    counts: Vec<u32>,
    count: u32,
}

impl Drawn {
    /// None, of this tessellation. Takes memory only where there was less.
    pub(super) fn clear(&mut self, tessellation: &Tessellation) {
        self.bits.clear();
        self.bits.resize(tessellation.slot_count().div_ceil(BITS) as usize, 0);
        self.counts.clear();
        self.counts.resize(tessellation.leaves().len(), 0);
        self.count = 0;
    }

    /// The same as another. Takes memory only where there was less.
    pub(super) fn copy(&mut self, other: &Self) {
        self.bits.clone_from(&other.bits);
        self.counts.clone_from(&other.counts);
        self.count = other.count;
    }

    /// Whether the triangle is held.
    #[inline]
    pub fn holds(&self, slot: u32) -> bool {
        self.bits[(slot / BITS) as usize] >> (slot % BITS) & 1 == 1
    }

    /// Takes a triangle of the leaf at `place`, which is not held yet.
    #[inline]
    pub(super) fn take(&mut self, place: u32, slot: u32) {
        self.bits[(slot / BITS) as usize] |= 1 << (slot % BITS);
        self.counts[place as usize] += 1;
        self.count += 1;
    }

    /// How many triangles.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// How many triangles of the leaf at `place`.
    #[inline]
    pub fn count_of(&self, place: u32) -> u32 {
        self.counts[place as usize]
    }

    /// The leaves of which it holds triangles, ascending: place in [`Tessellation::leaves`], and how many triangles.
    pub fn leaves(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..).zip(&self.counts).filter(|(_, count)| **count > 0).map(|(place, count)| (place, *count))
    }

    /// The numbers of the triangles that it holds of the leaf at `place`, ascending.
    pub fn triangles<'a>(&'a self, tessellation: &Tessellation, place: u32) -> impl Iterator<Item = u16> + 'a {
        let slots = tessellation.slots(place);
        let (first, end) = (slots.start, slots.end);
        let words = if slots.is_empty() { 0..0 } else { first / BITS..(end - 1) / BITS + 1 };
        words.flat_map(move |word| {
            let mut bits = self.bits[word as usize];
            // What lies before and behind the leaf in its first and last word.
            if word == first / BITS {
                bits &= u64::MAX << (first % BITS);
            }
            if word == (end - 1) / BITS {
                bits &= u64::MAX >> (BITS - 1 - (end - 1) % BITS);
            }
            std::iter::from_fn(move || {
                let bit = (bits != 0).then(|| bits.trailing_zeros())?;
                bits &= bits - 1;
                Some((word * BITS + bit - first) as u16)
            })
        })
    }
}
