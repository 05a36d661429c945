//! The outer shell: a `.glb` or `.gltf` file split into its JSON and its binary chunk.
//! GLB layout: glTF 2.0 specification, section 4.

use std::ops::Range;
use std::path::Path;

use super::error::{Fault, one_line};
use crate::prepare::bounded;

/// Largest single file read, in bytes: a GLB states its own length in 32 bits.
pub const MAX_FILE_BYTES: u64 = u32::MAX as u64;
/// Largest JSON part, in bytes.
pub const MAX_JSON_BYTES: u64 = 512 << 20;

const MAGIC: &[u8; 4] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;

/// A scene file in memory, read once; its parts are ranges of it.
pub(super) struct Container {
    file: Vec<u8>,
    json: Range<usize>,
    bin: Option<Range<usize>>,
    pub warnings: Vec<String>,
}

impl Container {
    pub fn read(path: &Path) -> Result<Container, Fault> {
        let file = read_bounded(path, MAX_FILE_BYTES)?;
        if file.is_empty() {
            return Err(Fault::Json("the file is empty".into()));
        }
        if file.starts_with(MAGIC) {
            return split_glb(file);
        }
        let start = if file.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 };
        match file[start..].iter().find(|byte| !byte.is_ascii_whitespace()) {
            Some(b'{') => {}
            _ => {
                return Err(Fault::Json("the file is neither GLB (no `glTF` magic) nor a JSON object".into()));
            }
        }
        let json = start..file.len();
        check_json_size(json.len())?;
        Ok(Container { file, json, bin: None, warnings: Vec::new() })
    }

    pub fn json(&self) -> &[u8] {
        &self.file[self.json.clone()]
    }

    /// The GLB's binary chunk, if there is one.
    pub fn bin(&self) -> Option<&[u8]> {
        self.bin.clone().map(|range| &self.file[range])
    }
}

/// Reads a regular file of at most `cap` bytes.
pub(super) fn read_bounded(path: &Path, cap: u64) -> Result<Vec<u8>, Fault> {
    bounded::read(path, cap).map_err(|e| Fault::Io { path: one_line(path.display()), reason: e.to_string() })
}

fn split_glb(file: Vec<u8>) -> Result<Container, Fault> {
    let fault = |reason: String| Err(Fault::Container(reason));
    let mut warnings = Vec::new();
    let (Some(version), Some(stated)) = (u32_at(&file, 4), u32_at(&file, 8)) else {
        return fault(format!("{} bytes are too few for the header of {HEADER_BYTES}", file.len()));
    };
    if version != 2 {
        return fault(format!("container version {version}, only 2 is read"));
    }
    let stated = stated as usize;
    if stated > file.len() {
        return fault(format!("truncated: the header states {stated} bytes, the file has {}", file.len()));
    }
    if stated < file.len() {
        warnings.push(format!("{} bytes after the GLB's end are ignored", file.len() - stated));
    }
    let (mut json, mut bin) = (None, None);
    let mut at = HEADER_BYTES;
    let mut chunk = 0;
    while at < stated {
        let header = &file[at..stated];
        let (Some(length), Some(kind)) = (u32_at(header, 0), u32_at(header, 4)) else {
            return fault(format!("chunk {chunk}: header cut off at byte {at}"));
        };
        let length = length as usize;
        let body = at + CHUNK_HEADER_BYTES;
        if length > stated - body {
            return fault(format!("chunk {chunk}: states {length} bytes, {} are left", stated - body));
        }
        if !length.is_multiple_of(4) {
            return fault(format!("chunk {chunk}: length {length} is not a multiple of 4"));
        }
        match (chunk, kind) {
            (0, CHUNK_JSON) => json = Some(body..body + length),
            (0, _) => {
                return fault(format!("chunk 0: type {kind:#010x}, the first chunk must be JSON"));
            }
            (1, CHUNK_BIN) => bin = Some(body..body + length),
            (_, CHUNK_JSON | CHUNK_BIN) => {
                return fault(format!("chunk {chunk}: a second or misplaced JSON or BIN chunk"));
            }
            _ => warnings.push(format!("GLB chunk {chunk} of unknown type {kind:#010x} is ignored")),
        }
        at = body + length;
        chunk += 1;
    }
    let Some(json) = json else {
        return fault("there is no JSON chunk".into());
    };
    check_json_size(json.len())?;
    Ok(Container { file, json, bin, warnings })
}

fn check_json_size(bytes: usize) -> Result<(), Fault> {
    if bytes as u64 > MAX_JSON_BYTES {
        return Err(Fault::Json(format!("{bytes} bytes of JSON, at most {MAX_JSON_BYTES} are read")));
    }
    Ok(())
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|word| u32::from_le_bytes(*word))
}
