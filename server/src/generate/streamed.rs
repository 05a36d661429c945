//! One mesh as a GLB that is never in memory as a whole: vertices are computed twice, once for their bounds, which stand at a file's beginning,
//! and once to be written.
use super::glb_writer::GenerateReport;
use glam::Vec3;
use rayon::prelude::*;
use serde_json::json;
use std::io::{self, Write};
use std::ops::Range;

/// Vertices, or triangles, that are in memory at a time.
const AT_A_TIME: u32 = 1 << 20;
/// Those that a thread computes at a time.
const OF_A_THREAD: u32 = 1 << 14;

/// A mesh by the numbers of its vertices and triangles.
pub trait StreamedMesh: Sync {
    /// How it is called.
    fn name(&self) -> &'static str;
    fn vertices(&self) -> u32;
    fn triangles(&self) -> u32;
    /// Where a vertex is, metres.
    fn position(&self, vertex: u32) -> Vec3;
    /// A triangle, counterclockwise from outside.
    fn triangle(&self, triangle: u32) -> [u32; 3];
    /// Linear RGB of its material.
    fn color(&self) -> [f32; 3];
}

/// Writes the mesh as a file of one object.
pub fn write(mesh: &impl StreamedMesh, out: &mut impl Write) -> io::Result<GenerateReport> {
    let (vertices, triangles) = (mesh.vertices(), mesh.triangles());
    let mut bounds = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for range in pieces(0..vertices, AT_A_TIME) {
        let of_piece = |piece: Range<u32>| {
            let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            piece.map(|v| mesh.position(v)).fold(start, |(low, high), p| (low.min(p), high.max(p)))
        };
        let parts: Vec<Range<u32>> = pieces(range, OF_A_THREAD).collect();
        let found: Vec<(Vec3, Vec3)> = parts.into_par_iter().map(of_piece).collect();
        bounds = found.into_iter().fold(bounds, |(low, high), (l, h)| (low.min(l), high.max(h)));
    }
    let position_bytes = u64::from(vertices) * 12;
    let bin_bytes = position_bytes + u64::from(triangles) * 12;
    let [r, g, b] = mesh.color();
    let root = json!({
        "asset": { "version": "2.0", "generator": format!("mullion generate {}", mesh.name()) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": mesh.name(), "mesh": 0 }],
        "meshes": [{ "name": mesh.name(), "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{
            "name": mesh.name(),
            "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9 },
        }],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3",
                "min": bounds.0.to_array(), "max": bounds.1.to_array(),
            },
            { "bufferView": 1, "componentType": 5125, "count": u64::from(triangles) * 3, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": position_bytes, "byteStride": 12, "target": 34962 },
            { "buffer": 0, "byteOffset": position_bytes, "byteLength": bin_bytes - position_bytes, "target": 34963 },
        ],
        "buffers": [{ "byteLength": bin_bytes }],
    });
    let mut json = serde_json::to_vec(&root)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    let bytes = 28 + json.len() as u64 + bin_bytes;
    let word = |value: u64| u32::try_from(value).map(u32::to_le_bytes).map_err(|_| io::Error::other("a GLB has less than 4 GiB"));
    out.write_all(b"glTF")?;
    out.write_all(&word(2)?)?;
    out.write_all(&word(bytes)?)?;
    out.write_all(&word(json.len() as u64)?)?;
    out.write_all(b"JSON")?;
    out.write_all(&json)?;
    out.write_all(&word(bin_bytes)?)?;
    out.write_all(b"BIN\0")?;
    write_all(vertices, |v| mesh.position(v).to_array(), out)?;
    write_all(triangles, |t| mesh.triangle(t), out)?;
    Ok(GenerateReport { triangles: triangles.into(), nodes: 1, objects: 1, bytes })
}

fn write_all<T: bytemuck::NoUninit + Send>(count: u32, of: impl Fn(u32) -> T + Sync, out: &mut impl Write) -> io::Result<()> {
    for range in pieces(0..count, AT_A_TIME) {
        let piece: Vec<T> = range.into_par_iter().map(&of).collect();
        out.write_all(bytemuck::cast_slice(&piece))?;
    }
    Ok(())
}

fn pieces(range: Range<u32>, size: u32) -> impl Iterator<Item = Range<u32>> {
    let end = range.end;
    range.step_by(size as usize).map(move |start| start..start.saturating_add(size).min(end))
}
