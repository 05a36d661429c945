//! What can be wrong with a scene file, in one line that names the file, the place and the reason.
use std::fmt::Display;

/// Longest reason or place that an error or a warning quotes from a file, in characters.
const MAX_QUOTED_CHARS: usize = 300;

/// A scene file that could not be imported. Its `Display` is one line: `city.glb: accessor 12: …`.
#[derive(Debug, thiserror::Error)]
#[error("{}{kind}", where_it_is(file, kind))]
pub struct ImportError {
    /// The path as the caller gave it.
    pub file: String,
    /// What is wrong, and where.
    pub kind: ImportErrorKind,
}

/// The file, unless the fault names it anyway.
fn where_it_is(file: &str, kind: &ImportErrorKind) -> String {
    match kind {
        ImportErrorKind::Io { path, .. } if path == file => String::new(),
        _ => format!("{file}: "),
    }
}

/// The kinds of fault an import can end with.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImportErrorKind {
    /// The file, or a file it names, could not be read.
    #[error("cannot read {path}: {reason}")]
    Io {
        /// The file that could not be read.
        path: String,
        /// What the system said.
        reason: String,
    },
    /// The GLB container is damaged.
    #[error("damaged GLB: {0}")]
    Container(String),
    /// The JSON does not parse, or a value has the wrong type.
    #[error("JSON: {0}")]
    Json(String),
    /// The asset is of another glTF version.
    #[error("asset: {0}")]
    Version(String),
    /// The asset requires an extension that this importer does not read.
    #[error("requires the extension {0}, which is not supported")]
    Extension(String),
    /// A value breaks a rule of the format.
    #[error("{place}: {reason}")]
    Invalid {
        /// The glTF object, such as `accessor 12`.
        place: String,
        /// The rule that it breaks, with the values.
        reason: String,
    },
    /// A value is beyond what this importer accepts.
    #[error("{place}: {reason} (the limit {cap} is {limit})")]
    Cap {
        /// The glTF object, such as `node 70000`.
        place: String,
        /// What is too much.
        reason: String,
        /// The constant's name.
        cap: &'static str,
        /// The constant's value.
        limit: u64,
    },
}

/// Short name inside the importer, where the file's name is not yet attached.
pub(super) type Fault = ImportErrorKind;

pub(super) fn invalid(place: impl Display, reason: impl Display) -> Fault {
    Fault::Invalid { place: one_line(place), reason: one_line(reason) }
}

pub(super) fn over_cap(place: impl Display, reason: impl Display, cap: &'static str, limit: u64) -> Fault {
    Fault::Cap { place: one_line(place), reason: one_line(reason), cap, limit }
}

/// Text from a file made fit for one line: control characters replaced, length bounded.
pub(super) fn one_line(text: impl Display) -> String {
    let text = text.to_string();
    let mut line: String = text.chars().take(MAX_QUOTED_CHARS).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(MAX_QUOTED_CHARS).is_some() {
        line.push('…');
    }
    line
}

/// The object that reference `index` names in `list`, or a fault that names both sides.
pub(super) fn resolve<'l, T>(list: &'l [T], index: u64, what: &'static str, from: impl Display) -> Result<(usize, &'l T), Fault> {
    usize::try_from(index)
        .ok()
        .and_then(|k| list.get(k).map(|item| (k, item)))
        .ok_or_else(|| invalid(from, format_args!("names {what} {index}, but the file has {}", list.len())))
}
