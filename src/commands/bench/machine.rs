//! What figures were measured on.

use std::fmt;
use std::fs;

use serde::Serialize;

/// A machine, as far as it says. Linux tells all; other systems tell less.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    pub cpu: String,
    /// That this process may use.
    pub cores: usize,
    pub os: String,
}

impl Machine {
    /// This one.
    pub fn this() -> Self {
        let told = |file: &str, key: &str| fs::read_to_string(file).ok().and_then(|text| value_of(&text, key));
        let system = told("/etc/os-release", "PRETTY_NAME").unwrap_or_else(|| std::env::consts::OS.to_owned());
        Self {
            cpu: told("/proc/cpuinfo", "model name").unwrap_or_else(|| "unknown".to_owned()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            os: format!("{system}, {}", std::env::consts::ARCH),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cpu, cores, os } = self;
        write!(f, "{cpu}, {cores} cores, {os}")
    }
}

/// The first value of `key` in lines of `key : value` or `KEY="value"`.
fn value_of(text: &str, key: &str) -> Option<String> {
    let value = text.lines().find_map(|line| {
        let (name, value) = line.split_once([':', '='])?;
        (name.trim() == key).then(|| value.trim().trim_matches('"').to_owned())
    });
    value.filter(|value| !value.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_where_systems_write_them() {
        let cpu = "processor\t: 0\nmodel name\t: A CPU @ 2.1GHz\nmodel name\t: another\n";
        assert_eq!(value_of(cpu, "model name").as_deref(), Some("A CPU @ 2.1GHz"));
        assert_eq!(value_of("ID=x\nPRETTY_NAME=\"An OS 1\"\n", "PRETTY_NAME").as_deref(), Some("An OS 1"));
        assert_eq!(value_of("model name\t:\n", "model name"), None);
        assert!(Machine::this().cores > 0);
    }
}
