//! URIs in a scene file: embedded data, or files inside the asset's own folder and nowhere else.
use super::container::read_bounded;
use super::error::{Fault, invalid, one_line};
use std::path::{Path, PathBuf};

/// Where a URI leads.
pub(super) enum Target {
    /// Bytes embedded as base64 or percent-encoded text.
    Data(Vec<u8>),
    /// A relative path that stays inside the folder as far as its text goes.
    File(PathBuf),
}

/// Reads what `uri` leads to; `place` names the glTF object in faults.
pub(super) fn read(uri: &str, folder: &Path, place: &str, cap: u64) -> Result<Vec<u8>, Fault> {
    match parse(uri, place)? {
        Target::Data(bytes) => Ok(bytes),
        Target::File(relative) => read_inside(&relative, folder, place, cap),
    }
}

/// Checks a URI's text without touching the disk: no scheme but `data`, not absolute, never above the folder.
pub(super) fn parse(uri: &str, place: &str) -> Result<Target, Fault> {
    if let Some(rest) = strip_prefix_ignore_case(uri, "data:") {
        return data(rest, place).map(Target::Data);
    }
    let scheme_end = uri.find([':', '/', '\\', '?', '#']);
    if scheme_end.is_some_and(|at| uri.as_bytes()[at] == b':') {
        return Err(invalid(place, format_args!("URI {:?}: only relative files and data: are read", head(uri))));
    }
    let decoded = percent_decode(uri.as_bytes());
    let path = std::str::from_utf8(&decoded).map_err(|_| invalid(place, format_args!("URI {:?} is not UTF-8", head(uri))))?;
    let climbs = || invalid(place, format_args!("URI {:?} leaves the asset's folder", head(uri)));
    if path.is_empty() || path.contains('\0') {
        return Err(invalid(place, format_args!("URI {:?} names no file", head(uri))));
    }
    if path.starts_with(['/', '\\']) || path.as_bytes().get(1) == Some(&b':') {
        return Err(climbs());
    }
    let mut depth = 0i64;
    for part in path.split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." => depth -= 1,
            _ => depth += 1,
        }
        if depth < 0 {
            return Err(climbs());
        }
    }
    Ok(Target::File(PathBuf::from(path)))
}

/// The one name of the file that `uri` leads to, however it is spelt; `None` where it leads to none.
pub(super) fn locate(uri: &str, folder: &Path) -> Option<PathBuf> {
    match parse(uri, "") {
        Ok(Target::File(relative)) => folder.join(relative).canonicalize().ok(),
        _ => None,
    }
}

fn read_inside(relative: &Path, folder: &Path, place: &str, cap: u64) -> Result<Vec<u8>, Fault> {
    let io = |path: &Path, e: std::io::Error| Fault::Io { path: one_line(path.display()), reason: e.to_string() };
    let base = folder.canonicalize().map_err(|e| io(folder, e))?;
    let joined = folder.join(relative);
    // Symbolic links are followed here, and only here.
    let real = joined.canonicalize().map_err(|e| io(&joined, e))?;
    if !real.starts_with(&base) {
        return Err(invalid(
            place,
            format_args!("URI {:?} leaves the asset's folder through a link", relative.display().to_string()),
        ));
    }
    read_bounded(&real, cap)
}

fn data(rest: &str, place: &str) -> Result<Vec<u8>, Fault> {
    let Some((kind, body)) = rest.split_once(',') else {
        return Err(invalid(place, "data URI without a comma"));
    };
    if kind.to_ascii_lowercase().ends_with(";base64") {
        base64(body.as_bytes()).ok_or_else(|| invalid(place, "data URI with damaged base64"))
    } else {
        Ok(percent_decode(body.as_bytes()))
    }
}

/// Standard and URL-safe alphabets; padding and white space are optional.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut word, mut bits) = (0u32, 0u32);
    let mut padding = 0;
    for &byte in text {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' => {
                padding += 1;
                continue;
            }
            b if b.is_ascii_whitespace() => continue,
            _ => return None,
        };
        if padding > 0 {
            return None;
        }
        word = (word << 6) | u32::from(value);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            out.push((word >> bits) as u8);
        }
    }
    // Six left-over bits are half a byte: the text was cut.
    (bits < 6 && padding <= 2).then_some(out)
}

fn percent_decode(text: &[u8]) -> Vec<u8> {
    let hex = |byte: Option<&u8>| byte.and_then(|b| (*b as char).to_digit(16));
    let mut out = Vec::with_capacity(text.len());
    let mut at = 0;
    while at < text.len() {
        match (text[at], hex(text.get(at + 1)), hex(text.get(at + 2))) {
            (b'%', Some(high), Some(low)) => {
                out.push((high * 16 + low) as u8);
                at += 3;
            }
            (byte, ..) => {
                out.push(byte);
                at += 1;
            }
        }
    }
    out
}

fn strip_prefix_ignore_case<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let start = text.get(..prefix.len())?;
    start.eq_ignore_ascii_case(prefix).then(|| &text[prefix.len()..])
}

fn head(uri: &str) -> String {
    uri.chars().take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(uri: &str) -> Option<Vec<u8>> {
        match parse(uri, "buffer 0") {
            Ok(Target::Data(bytes)) => Some(bytes),
            _ => None,
        }
    }

    #[test]
    fn base64_of_every_remainder() {
        assert_eq!(bytes("data:application/octet-stream;base64,").unwrap(), b"");
        assert_eq!(bytes("data:;base64,TQ==").unwrap(), b"M");
        assert_eq!(bytes("data:;base64,TWE=").unwrap(), b"Ma");
        assert_eq!(bytes("DATA:;BASE64,TWFu").unwrap(), b"Man");
        assert_eq!(bytes("data:;base64,TWE").unwrap(), b"Ma");
        assert!(bytes("data:;base64,T").is_none());
        assert!(bytes("data:;base64,T*==").is_none());
        assert!(bytes("data:;base64").is_none());
    }

    #[test]
    fn only_paths_inside_the_folder_pass() {
        for good in ["a.bin", "sub/a.bin", "sub/../a.bin", "a%20b.bin", "./a.bin", "..a"] {
            assert!(matches!(parse(good, "buffer 0"), Ok(Target::File(_))), "{good}");
        }
        for bad in [
            "../a.bin",
            "sub/../../a.bin",
            "/etc/passwd",
            "%2e%2e/a.bin",
            "%2E%2E%2Fa.bin",
            "..\\a.bin",
            "\\\\host\\a",
            "C:\\a.bin",
            "http://host/a.bin",
            "file:///etc/passwd",
            "a%00b",
            "",
            "%2fetc/passwd",
        ] {
            assert!(parse(bad, "buffer 0").is_err(), "{bad}");
        }
    }
}
