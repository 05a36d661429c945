//! Accessors: typed, strided, sparse arrays in buffer views, decoded to plain vectors.
//! glTF 2.0 specification, section 3.6.2; reads assume nothing about alignment.
use super::error::{Fault, invalid, over_cap, resolve};
use super::json;
use super::validate::{Asset, Budget, View, ViewBytes};
use std::fmt::Display;

/// Most elements of an accessor without a buffer view: it costs the file nothing, and us all of it.
pub const MAX_ZERO_FILLED_ELEMENTS: u64 = 1 << 22;
/// Most elements of any accessor: vertex ids are 32 bits.
pub const MAX_ACCESSOR_ELEMENTS: u64 = u32::MAX as u64;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn parse(value: u64) -> Option<Component> {
        Some(match value {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Shape {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    Mat2,
    Mat3,
    Mat4,
}

impl Shape {
    fn parse(text: &str) -> Option<Shape> {
        Some(match text {
            "SCALAR" => Shape::Scalar,
            "VEC2" => Shape::Vec2,
            "VEC3" => Shape::Vec3,
            "VEC4" => Shape::Vec4,
            "MAT2" => Shape::Mat2,
            "MAT3" => Shape::Mat3,
            "MAT4" => Shape::Mat4,
            _ => return None,
        })
    }

    fn components(self) -> usize {
        match self {
            Shape::Scalar => 1,
            Shape::Vec2 => 2,
            Shape::Vec3 => 3,
            Shape::Vec4 | Shape::Mat2 => 4,
            Shape::Mat3 => 9,
            Shape::Mat4 => 16,
        }
    }

    /// Size of one element; the columns of a matrix start at multiples of 4 bytes.
    fn bytes(self, component: Component) -> usize {
        let column = |rows: usize| (rows * component.bytes()).next_multiple_of(4);
        match self {
            Shape::Mat2 => 2 * column(2),
            Shape::Mat3 => 3 * column(3),
            Shape::Mat4 => 4 * column(4),
            _ => self.components() * component.bytes(),
        }
    }
}

/// Elements at `k * stride`; the last one ends inside `bytes`.
#[derive(Clone, Copy)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
    count: usize,
}

#[derive(Clone, Copy)]
enum Data<'a> {
    Zeros,
    Here(Strided<'a>),
    Absent,
}

struct Sparse<'a> {
    indices: Strided<'a>,
    index_component: Component,
    values: Strided<'a>,
}

/// An accessor whose every byte is known to lie in its view.
pub(super) struct Accessor<'a> {
    pub index: usize,
    pub component: Component,
    pub shape: Shape,
    pub normalized: bool,
    pub count: usize,
    data: Data<'a>,
    sparse: Option<Sparse<'a>>,
}

impl<'a> Accessor<'a> {
    /// Looks up and checks accessor `index`; `from` names the object that refers to it. Takes no longer for a long
    /// accessor: its sparse indices were read by [`Self::check_sparse`].
    pub fn resolve(asset: &'a Asset<'_>, index: u64, from: impl Display) -> Result<Accessor<'a>, Fault> {
        let (index, raw) = resolve(&asset.json.accessors, index, "accessor", from)?;
        let place = format!("accessor {index}");
        let component = component(raw.component_type, &place)?;
        let shape = raw.shape.as_deref().ok_or_else(|| invalid(&place, "type is missing"))?;
        let shape = Shape::parse(shape).ok_or_else(|| invalid(&place, format_args!("type {shape:?} is not known")))?;
        let count = raw.count.ok_or_else(|| invalid(&place, "count is missing"))?.0;
        if count == 0 {
            return Err(invalid(place, "count is 0, at least 1 is required"));
        }
        if raw.normalized && matches!(component, Component::U32 | Component::F32) {
            return Err(invalid(place, "normalized is only for 8 and 16 bit integers"));
        }
        let size = shape.bytes(component);
        let data = match raw.buffer_view {
            None => {
                if count > MAX_ZERO_FILLED_ELEMENTS {
                    let reason = format!("count {count} without a bufferView");
                    return Err(over_cap(place, reason, "MAX_ZERO_FILLED_ELEMENTS", MAX_ZERO_FILLED_ELEMENTS));
                }
                Data::Zeros
            }
            Some(view) => elements(asset, view.0, raw.byte_offset.0, count, size, Stride::OfView, &place)?,
        };
        if count > MAX_ACCESSOR_ELEMENTS {
            return Err(over_cap(place, format!("count {count}"), "MAX_ACCESSOR_ELEMENTS", MAX_ACCESSOR_ELEMENTS));
        }
        let sparse = match &raw.sparse {
            None => None,
            Some(sparse) => Some(Sparse::resolve(asset, sparse, count, size, &place)?),
        };
        // In range: below MAX_ACCESSOR_ELEMENTS.
        Ok(Accessor { index, component, shape, normalized: raw.normalized, count: count as usize, data, sparse })
    }

    /// Checks that the sparse indices increase and stay below the count. Once for each accessor, before any is decoded.
    pub fn check_sparse(&self, budget: &Budget) -> Result<(), Fault> {
        let Some(sparse) = &self.sparse else {
            return Ok(());
        };
        let place = || format!("{} sparse", self.place());
        // Accessors may share their indices, so that their lengths add up to more than the file has.
        budget.take(sparse.indices.count, size_of::<u32>(), place)?;
        let mut previous = None;
        for [index] in integers::<1>(sparse.indices, sparse.index_component) {
            if index as usize >= self.count {
                return Err(invalid(place(), format_args!("index {index} is past the count {}", self.count)));
            }
            if previous.is_some_and(|before| before >= index) {
                return Err(invalid(place(), format_args!("index {index} does not increase")));
            }
            previous = Some(index);
        }
        Ok(())
    }

    /// Whether it has no buffer view, so that its count costs the file nothing.
    pub fn is_zero_filled(&self) -> bool {
        matches!(self.data, Data::Zeros)
    }

    pub fn place(&self) -> String {
        format!("accessor {}", self.index)
    }

    /// Elements as floats; normalized integers become -1 to 1 or 0 to 1, others keep their value.
    pub fn floats<const N: usize>(&self, asset: &Asset) -> Result<Vec<[f32; N]>, Fault>
    where
        [f32; N]: bytemuck::Pod,
    {
        let (component, normalized) = (self.component, self.normalized);
        self.collect(asset, |s| match (component, normalized) {
            (Component::F32, _) if s.stride == 4 * N && cfg!(target_endian = "little") => {
                bytemuck::pod_collect_to_vec(&s.bytes[..s.count * 4 * N])
            }
            (Component::F32, _) => gather(s, f32::from_le_bytes),
            (Component::I8, false) => gather(s, |b| f32::from(i8::from_le_bytes(b))),
            (Component::I8, true) => gather(s, |b| (f32::from(i8::from_le_bytes(b)) / 127.0).max(-1.0)),
            (Component::U8, false) => gather(s, |b| f32::from(u8::from_le_bytes(b))),
            (Component::U8, true) => gather(s, |b| f32::from(u8::from_le_bytes(b)) / 255.0),
            (Component::I16, false) => gather(s, |b| f32::from(i16::from_le_bytes(b))),
            (Component::I16, true) => gather(s, |b| (f32::from(i16::from_le_bytes(b)) / 32767.0).max(-1.0)),
            (Component::U16, false) => gather(s, |b| f32::from(u16::from_le_bytes(b))),
            (Component::U16, true) => gather(s, |b| f32::from(u16::from_le_bytes(b)) / 65535.0),
            (Component::U32, _) => gather(s, |b| u32::from_le_bytes(b) as f32),
        })
    }

    /// Elements as unsigned integers. The caller has checked that the component is unsigned.
    pub fn integers<const N: usize>(&self, asset: &Asset) -> Result<Vec<[u32; N]>, Fault>
    where
        [u32; N]: bytemuck::Pod,
    {
        let component = self.component;
        self.collect(asset, |s| integers(s, component))
    }

    fn collect<O: Copy + Default, const N: usize>(
        &self,
        asset: &Asset,
        read: impl Fn(Strided) -> Vec<[O; N]>,
    ) -> Result<Vec<[O; N]>, Fault> {
        if self.shape.components() != N {
            return Err(invalid(self.place(), format_args!("type {:?}, {N} components were expected", self.shape)));
        }
        asset.budget.take(self.count, size_of::<[O; N]>(), || self.place())?;
        if let Some(sparse) = &self.sparse {
            asset.budget.take(sparse.values.count, size_of::<[O; N]>() + size_of::<u32>(), || self.place())?;
        }
        let mut out = match self.data {
            Data::Zeros => vec![[O::default(); N]; self.count],
            Data::Here(strided) => read(strided),
            Data::Absent => return Err(invalid(self.place(), "its buffer has no data")),
        };
        if let Some(sparse) = &self.sparse {
            let values = read(sparse.values);
            for ([k], value) in integers::<1>(sparse.indices, sparse.index_component).into_iter().zip(values) {
                // In range: `Asset::new` has called `check_sparse`.
                out[k as usize] = value;
            }
        }
        Ok(out)
    }
}

impl<'a> Sparse<'a> {
    fn resolve(asset: &'a Asset<'_>, raw: &json::Sparse, count: u64, size: usize, place: &str) -> Result<Sparse<'a>, Fault> {
        let place = format!("{place} sparse");
        let replaced = raw.count.0;
        if replaced == 0 || replaced > count {
            return Err(invalid(place, format_args!("count {replaced}, allowed are 1 to {count}")));
        }
        let index_component = component(Some(raw.indices.component_type), &place)?;
        if !matches!(index_component, Component::U8 | Component::U16 | Component::U32) {
            return Err(invalid(place, "indices must be unsigned integers"));
        }
        let part =
            |view: u64, offset: u64, size: usize| match elements(asset, view, offset, replaced, size, Stride::Tight, &place)? {
                Data::Here(strided) => Ok(strided),
                _ => Err(invalid(&place, format_args!("bufferView {view} has no data"))),
            };
        let indices = part(raw.indices.buffer_view.0, raw.indices.byte_offset.0, index_component.bytes())?;
        let values = part(raw.values.buffer_view.0, raw.values.byte_offset.0, size)?;
        Ok(Sparse { indices, index_component, values })
    }
}

fn component(value: Option<json::Int>, place: &str) -> Result<Component, Fault> {
    let value = value.ok_or_else(|| invalid(place, "componentType is missing"))?.0;
    Component::parse(value).ok_or_else(|| invalid(place, format_args!("componentType {value} is not known")))
}

enum Stride {
    OfView,
    Tight,
}

/// The elements in view `view`, once every one of them is known to lie in it.
fn elements<'a>(
    asset: &'a Asset<'_>,
    view: u64,
    offset: u64,
    count: u64,
    size: usize,
    stride: Stride,
    place: &str,
) -> Result<Data<'a>, Fault> {
    let (v, View { bytes, byte_length, byte_stride }) = resolve(&asset.views, view, "bufferView", place)?;
    let stride = match stride {
        Stride::OfView => byte_stride.unwrap_or(size),
        Stride::Tight => size,
    };
    if stride < size {
        return Err(invalid(place, format_args!("elements of {size} bytes overlap at bufferView {v}'s byteStride {stride}")));
    }
    let end = (count - 1)
        .checked_mul(stride as u64)
        .and_then(|bytes| bytes.checked_add(size as u64))
        .and_then(|bytes| bytes.checked_add(offset));
    if end.is_none_or(|end| end > *byte_length as u64) {
        let needed = end.map_or("more than 2^64".to_string(), |end| end.to_string());
        return Err(invalid(
            place,
            format_args!("count {count} needs {needed} bytes, but bufferView {v} has {byte_length} bytes"),
        ));
    }
    Ok(match bytes {
        // In range: `offset < end <= byte_length`, the slice's length.
        ViewBytes::Here(bytes) => {
            let strided = Strided { bytes: &bytes[offset as usize..], stride, count: count as usize };
            Data::Here(strided)
        }
        ViewBytes::Absent => Data::Absent,
    })
}

fn integers<const N: usize>(s: Strided, component: Component) -> Vec<[u32; N]>
where
    [u32; N]: bytemuck::Pod,
{
    match component {
        Component::U32 if s.stride == 4 * N && cfg!(target_endian = "little") => {
            bytemuck::pod_collect_to_vec(&s.bytes[..s.count * 4 * N])
        }
        Component::I8 | Component::U8 => gather(s, |b| u32::from(u8::from_le_bytes(b))),
        Component::I16 | Component::U16 => gather(s, |b| u32::from(u16::from_le_bytes(b))),
        Component::U32 | Component::F32 => gather(s, u32::from_le_bytes),
    }
}

/// `N` components of `S` bytes from each element.
fn gather<O, const N: usize, const S: usize>(s: Strided, convert: impl Fn([u8; S]) -> O) -> Vec<[O; N]> {
    (0..s.count)
        .map(|k| {
            let element = &s.bytes[k * s.stride..][..N * S];
            std::array::from_fn(|c| {
                let mut word = [0; S];
                word.copy_from_slice(&element[c * S..][..S]);
                convert(word)
            })
        })
        .collect()
}
