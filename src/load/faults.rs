//! What goes wrong in a load test, on purpose: processes of nodes that die and are started again, or hang and go on.

use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use mullion_server::generate::Random;
use mullion_server::prepare::bounded;
use serde::{Deserialize, Serialize};

use super::clients::ClientProcesses;

/// What happens to a process of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum What {
    /// It is ended, and started again later.
    Kill,
    /// It is stopped, and goes on later.
    Hang,
}

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// When, seconds after the first frame.
    pub at_s: f64,
    /// Which process of nodes, from 0.
    pub process: usize,
    /// What happens to it.
    pub what: What,
    /// How long until it is mended, milliseconds.
    pub for_ms: u64,
}

/// Where faults come from.
#[derive(Clone, Debug)]
pub enum Faults {
    /// Random ones, one after the other, each in its own share of the time.
    Seed(u64),
    /// A file: a JSON list of faults.
    File(Vec<Fault>),
}

/// Longest time to the mending of a random fault.
const MOST_MS: u64 = 400;
/// Processes are left alone for so long at the end, to come back in.
const QUIET_END_S: f64 = 3.0;

impl Faults {
    /// Takes a number as a seed, anything else as the name of a file.
    ///
    /// # Errors
    /// When the file is no list of faults.
    pub fn open(choice: &str) -> Result<Self> {
        const MAX_BYTES: u64 = 1 << 20;
        if let Ok(seed) = choice.parse() {
            return Ok(Self::Seed(seed));
        }
        let bytes = bounded::read(Path::new(choice), MAX_BYTES).with_context(|| choice.to_owned())?;
        let faults: Vec<Fault> = serde_json::from_slice(&bytes).map_err(|error| anyhow!("{choice}: {error}"))?;
        let is_time = |fault: &Fault| fault.at_s.is_finite() && fault.at_s >= 0.0;
        ensure!(faults.iter().all(is_time), "{choice}: at_s must be a number of seconds, 0 or more");
        Ok(Self::File(faults))
    }

    /// The faults of a test of so many seconds, in order: random ones every `every`.
    ///
    /// # Errors
    /// When one is to befall a process that is not there.
    pub fn plan(&self, processes: usize, seconds: f64, every: Duration) -> Result<Vec<Fault>> {
        let mut faults = match self {
            Self::File(faults) => faults.clone(),
            Self::Seed(seed) => {
                let mut random = Random::new(*seed);
                let count = ((seconds - QUIET_END_S).max(0.0) / every.as_secs_f64()) as u64;
                let fault = |k: u64| Fault {
                    at_s: every.as_secs_f64() * (k + 1) as f64,
                    process: (random.bits() % processes as u64) as usize,
                    what: if random.bits().is_multiple_of(4) { What::Hang } else { What::Kill },
                    for_ms: 20 + random.bits() % MOST_MS.min(every.as_millis() as u64),
                };
                (0..count).map(fault).collect()
            }
        };
        let stray = faults.iter().find(|fault| fault.process >= processes);
        ensure!(stray.is_none(), "a fault of process {}; there are {processes}, from 0", stray.map_or(0, |f| f.process));
        faults.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        Ok(faults)
    }
}

/// A fault as it happened.
#[derive(Clone, Debug)]
pub struct Happened {
    pub fault: Fault,
    /// Nodes of the wall that it befell.
    pub nodes: std::ops::Range<usize>,
    /// When.
    pub struck: Instant,
    /// When it was mended.
    pub mended: Instant,
}

/// Lets faults happen from `start` on, until all have or the other side of `stop` is gone. What was begun is mended.
///
/// # Errors
/// When a process cannot be ended or started.
pub fn happen(
    faults: &[Fault],
    mut clients: ClientProcesses,
    start: Instant,
    stop: &Receiver<()>,
) -> Result<(ClientProcesses, Vec<Happened>)> {
    let mut happened: Vec<Happened> = Vec::new();
    let sleep_until =
        |at: Instant| stop.recv_timeout(at.saturating_duration_since(Instant::now())) == Err(RecvTimeoutError::Timeout);
    for fault in faults {
        if !sleep_until(start + Duration::from_secs_f64(fault.at_s)) {
            break;
        }
        let struck = Instant::now();
        match fault.what {
            What::Kill => clients.kill(fault.process)?,
            What::Hang => clients.hang(fault.process, true)?,
        }
        let goes_on = sleep_until(struck + Duration::from_millis(fault.for_ms));
        match fault.what {
            What::Kill => clients.restart(fault.process)?,
            What::Hang => clients.hang(fault.process, false)?,
        }
        happened.push(Happened { fault: *fault, nodes: clients.nodes(fault.process), struck, mended: Instant::now() });
        if !goes_on {
            break;
        }
    }
    Ok((clients, happened))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_plans_the_same_faults_each_time_one_after_the_other() {
        let plan = |seed| Faults::Seed(seed).plan(8, 13.0, Duration::from_millis(500)).expect("a plan");
        let faults = plan(7);
        assert_eq!((faults.len(), &faults), (20, &plan(7)));
        assert_ne!(faults, plan(8));
        for pair in faults.windows(2) {
            assert!(pair[0].at_s + pair[0].for_ms as f64 / 1000.0 <= pair[1].at_s + 1e-9, "{pair:?}");
        }
        assert!(faults.iter().all(|fault| fault.process < 8));
        assert!([What::Kill, What::Hang].iter().all(|what| faults.iter().any(|fault| fault.what == *what)));
    }

    #[test]
    fn files_are_checked() {
        let folder = tempfile::tempdir().expect("a folder");
        let open = |text: &str| {
            let path = folder.path().join("faults.json");
            std::fs::write(&path, text).expect("written");
            Faults::open(&path.display().to_string())
        };
        let one = r#"[{"at_s": 1.5, "process": 1, "what": "hang", "for_ms": 20}]"#;
        let plan = |processes| open(one).expect("a file").plan(processes, 9.0, Duration::from_secs(1));
        assert_eq!(plan(2).expect("a plan").len(), 1);
        assert!(plan(1).is_err_and(|e| e.to_string().contains("process 1")));
        assert!(open(r#"[{"at_s": -1, "process": 1, "what": "hang", "for_ms": 20}]"#).is_err());
        assert!(open(r#"[{"at_s": 1, "process": 1, "what": "sing", "for_ms": 20}]"#).is_err());
        assert!(Faults::open("nowhere.json").is_err_and(|e| format!("{e:#}").contains("nowhere.json")));
    }
}
