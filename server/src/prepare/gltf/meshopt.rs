//! `EXT_meshopt_compression`: buffer views decoded by the meshopt crate, checked before it sees them.
//! The crate's decoders are safe on hostile bytes, but assert on strides and allocate what the count says.
use super::error::{Fault, invalid};
use super::json::Meshopt;
use super::validate::{Budget, Buffer};

/// No meshopt stream expands more than this: a block of 256 vertices whose bytes are all equal costs a
/// quarter byte per vertex byte in version 1 of the vertex codec, the densest of the three.
pub const MAX_MESHOPT_RATIO: u64 = 1024;

#[derive(Clone, Copy, PartialEq)]
enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// The decoded bytes of a view of `view_bytes`.
pub(super) fn decode(
    raw: &Meshopt,
    buffers: &[Option<Buffer>],
    view_bytes: u64,
    place: &str,
    budget: &Budget,
) -> Result<Vec<u8>, Fault> {
    let place = format!("{place} (meshopt)");
    let source = source_bytes(raw, buffers, &place)?;
    let (count, stride) = (raw.count.0, raw.byte_stride.0);
    let decoded = count.checked_mul(stride).filter(|bytes| *bytes == view_bytes);
    let Some(decoded) = decoded else {
        return Err(invalid(
            place,
            format_args!("count {count} of byteStride {stride} is not the view's byteLength {view_bytes}"),
        ));
    };
    if decoded > (source.len() as u64).saturating_mul(MAX_MESHOPT_RATIO) {
        return Err(invalid(place, format_args!("{} bytes cannot hold {decoded} decoded ones", source.len())));
    }
    // In range of usize: at most MAX_MESHOPT_RATIO times a slice that is in memory.
    let (count, stride) = (count as usize, stride as usize);
    budget.take(count, stride, || place.clone())?;
    let filter = match raw.filter.as_deref() {
        None | Some("NONE") => Filter::None,
        Some("OCTAHEDRAL") => Filter::Octahedral,
        Some("QUATERNION") => Filter::Quaternion,
        Some("EXPONENTIAL") => Filter::Exponential,
        Some("COLOR") => Filter::Color,
        Some(other) => {
            return Err(invalid(place, format_args!("filter {other:?} is not known")));
        }
    };
    let damaged = |_| invalid(&place, "the compressed bytes are damaged");
    match raw.mode.as_str() {
        "ATTRIBUTES" => {
            let fits = match filter {
                Filter::None | Filter::Exponential => true,
                Filter::Octahedral | Filter::Color => stride == 4 || stride == 8,
                Filter::Quaternion => stride == 8,
            };
            if stride == 0 || stride > 256 || !stride.is_multiple_of(4) || !fits {
                return Err(invalid(place, format_args!("byteStride {stride} does not fit its mode and filter")));
            }
            attributes(source, count, stride, filter).map_err(damaged)
        }
        mode @ ("TRIANGLES" | "INDICES") => {
            if filter != Filter::None || !(stride == 2 || stride == 4) || (mode == "TRIANGLES" && !count.is_multiple_of(3)) {
                return Err(invalid(
                    place,
                    format_args!("mode {mode} with byteStride {stride}, count {count} or a filter it cannot have"),
                ));
            }
            indices(source, count, stride, mode).map_err(damaged)
        }
        other => Err(invalid(place, format_args!("mode {other:?} is not known"))),
    }
}

fn source_bytes<'b>(raw: &Meshopt, buffers: &'b [Option<Buffer>], place: &str) -> Result<&'b [u8], Fault> {
    let buffer = raw.buffer.0;
    let bytes = usize::try_from(buffer)
        .ok()
        .and_then(|k| buffers.get(k))
        .ok_or_else(|| invalid(place, format_args!("names buffer {buffer}, but the file has {}", buffers.len())))?
        .as_ref()
        .ok_or_else(|| invalid(place, format_args!("buffer {buffer} has no data")))?;
    let (offset, length) = (raw.byte_offset.0, raw.byte_length.0);
    offset
        .checked_add(length)
        .filter(|end| *end <= bytes.len() as u64)
        .map(|end| &bytes[offset as usize..end as usize])
        .ok_or_else(|| {
            invalid(place, format_args!("bytes {offset} + {length} lie past the {} bytes of buffer {buffer}", bytes.len()))
        })
}

fn indices(source: &[u8], count: usize, stride: usize, mode: &str) -> meshopt::Result<Vec<u8>> {
    fn raw_bytes<T: bytemuck::Pod>(list: Vec<T>) -> Vec<u8> {
        bytemuck::cast_slice(&list).to_vec()
    }
    Ok(match (mode, stride) {
        ("TRIANGLES", 2) => raw_bytes(meshopt::decode_index_buffer::<u16>(source, count)?),
        ("TRIANGLES", _) => raw_bytes(meshopt::decode_index_buffer::<u32>(source, count)?),
        (_, 2) => raw_bytes(meshopt::decode_index_sequence::<u16>(source, count)?),
        _ => raw_bytes(meshopt::decode_index_sequence::<u32>(source, count)?),
    })
}

/// A vertex of `N` words: the crate wants its stride as a type.
#[derive(Clone, Copy)]
#[repr(transparent)]
struct Words<const N: usize>([u32; N]);

impl<const N: usize> Default for Words<N> {
    fn default() -> Self {
        Words([0; N])
    }
}

fn attributes(source: &[u8], count: usize, stride: usize, filter: Filter) -> meshopt::Result<Vec<u8>> {
    fn words<const N: usize>(source: &[u8], count: usize, filter: Filter) -> meshopt::Result<Vec<u8>> {
        let vertices = meshopt::decode_vertex_buffer::<Words<N>>(source, count)?;
        let mut flat: Vec<u32> = vertices.iter().flat_map(|vertex| vertex.0).collect();
        drop(vertices);
        match (filter, N) {
            (Filter::None, _) => {}
            (Filter::Octahedral, 1) => meshopt::decode_filter_oct::<i8>(bytemuck::cast_slice_mut(&mut flat)),
            (Filter::Octahedral, _) => meshopt::decode_filter_oct::<i16>(bytemuck::cast_slice_mut(&mut flat)),
            (Filter::Color, 1) => meshopt::decode_filter_color::<u8>(bytemuck::cast_slice_mut(&mut flat)),
            (Filter::Color, _) => meshopt::decode_filter_color::<u16>(bytemuck::cast_slice_mut(&mut flat)),
            (Filter::Quaternion, _) => meshopt::decode_filter_quat(bytemuck::cast_slice_mut(&mut flat)),
            (Filter::Exponential, _) => meshopt::decode_filter_exp::<1>(bytemuck::cast_slice_mut(&mut flat)),
        }
        Ok(bytemuck::cast_slice(&flat).to_vec())
    }
    macro_rules! by_stride {
        ($($n:literal)*) => {
            match stride / 4 {
                $($n => words::<$n>(source, count, filter),)*
                // Unreachable by the caller's check on the stride.
                _ => Err(meshopt::Error::Parse(format!("stride {stride}"))),
            }
        };
    }
    by_stride!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}
