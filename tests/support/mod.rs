//! What several integration tests need.
#![allow(dead_code)] // each test uses its part

pub mod masters;
pub mod painter;
pub mod random;
pub mod relay;
pub mod tiled;

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mullion_common::scene::Package;
use mullion_server::generate::{GeneratedScene, write_glb};
use mullion_server::prepare::{self, PrepareOptions};

/// The generated city, written once a test process.
pub fn city(folder: &Path) -> PathBuf {
    let path = folder.join("city.glb");
    write_glb(GeneratedScene::City, 1, &path).expect("the city can be written");
    path
}

/// A scene, prepared.
pub fn package(path: &Path, options: &PrepareOptions) -> Package {
    prepare::open(path, options, &|_, _, _| {}).unwrap_or_else(|e| panic!("{e}")).package
}

/// Third-party scenes by name, from the folder that `MULLION_MODELS` names; says so and gives none where it is unset.
pub fn models(names: &[&str]) -> Vec<PathBuf> {
    match std::env::var_os("MULLION_MODELS") {
        Some(folder) => names.iter().map(|name| Path::new(&folder).join(name)).collect(),
        None => {
            println!("skipped {names:?}: MULLION_MODELS is not set");
            Vec::new()
        }
    }
}

/// What a command did.
pub struct Outcome {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
    pub took: Duration,
}

/// Runs the binary to its end, which must come within `limit`.
pub fn mullion<S: AsRef<OsStr>>(args: &[S], limit: Duration) -> Outcome {
    let started = Instant::now();
    let mut process = Process::start(args);
    let code = process.wait(limit);
    Outcome { code, out: process.out.text(), err: process.err.text(), took: started.elapsed() }
}

/// A running `mullion`, killed when it is dropped; its lines are kept as they come.
pub struct Process {
    name: String,
    child: Child,
    pub out: Lines,
    pub err: Lines,
}

impl Process {
    pub fn start<S: AsRef<OsStr>>(args: &[S]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mullion"));
        if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
            command.env("XDG_RUNTIME_DIR", std::env::temp_dir()); // Mesa complains without one
        }
        command.args(args).env_remove("MULLION_LOG").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the binary starts");
        let out = Lines::of(child.stdout.take().expect("it is piped"));
        let err = Lines::of(child.stderr.take().expect("it is piped"));
        let name = args.iter().map(|a| a.as_ref().to_string_lossy()).collect::<Vec<_>>().join(" ");
        Self { name, child, out, err }
    }

    /// Its exit code, `None` where a signal ended it; panics when it is not over within `limit`.
    pub fn wait(&mut self, limit: Duration) -> Option<i32> {
        let mut status = None;
        self.until("its end", limit, |process| {
            status = process.child.try_wait().expect("a child");
            status.is_some()
        });
        self.out.join();
        self.err.join();
        status.and_then(|s| s.code())
    }

    /// Waits until `is_so`; panics with what the process printed when it is not within `limit`.
    pub fn until(&mut self, what: &str, limit: Duration, mut is_so: impl FnMut(&mut Self) -> bool) {
        let deadline = Instant::now() + limit;
        while !is_so(self) {
            let (out, err) = (self.out.text(), self.err.text());
            assert!(Instant::now() < deadline, "mullion {}: no {what} within {limit:?}\n{out}{err}", self.name);
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The first line of standard output that begins so.
    pub fn out_line(&mut self, start: &str, limit: Duration) -> String {
        let mut found = None;
        self.until(&format!("line {start:?}"), limit, |process| {
            found = process.out.lines().into_iter().find(|line| line.starts_with(start));
            found.is_some()
        });
        found.expect("it was just found")
    }

    /// The first line that holds all of `words`, at or after line `from` of standard error, and its number.
    pub fn error_line(&mut self, words: &[&str], from: usize, limit: Duration) -> (usize, String) {
        let mut found = None;
        self.until(&format!("line with {words:?}"), limit, |process| {
            let lines = process.err.lines();
            found = lines.into_iter().enumerate().skip(from).find(|(_, line)| words.iter().all(|w| line.contains(w)));
            assert!(found.is_some() || process.is_running(), "it ended before {words:?}:\n{}", process.err.text());
            found.is_some()
        });
        found.expect("it was just found")
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }

    /// Sends a signal, as one that stops it or lets it go on.
    #[cfg(unix)]
    pub fn signal(&mut self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, signal).expect("a child");
    }

    /// SIGKILL.
    pub fn kill(&mut self) {
        self.child.kill().expect("a child");
        self.child.wait().expect("a child");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill(); // over already
        let _ = self.child.wait();
    }
}

/// A stream's lines so far.
pub struct Lines {
    lines: Arc<Mutex<Vec<String>>>,
    reader: Option<JoinHandle<()>>,
}

impl Lines {
    fn of(stream: impl Read + Send + 'static) -> Self {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let shared = Arc::clone(&lines);
        let reader = std::thread::spawn(move || {
            let mut stream = BufReader::new(stream);
            let mut bytes = Vec::new();
            while stream.read_until(b'\n', &mut bytes).is_ok_and(|n| n > 0) {
                let line = String::from_utf8_lossy(&bytes).trim_end_matches('\n').to_owned();
                shared.lock().expect("no panic in there").push(line);
                bytes.clear();
            }
        });
        Self { lines, reader: Some(reader) }
    }

    pub fn lines(&self) -> Vec<String> {
        self.lines.lock().expect("no panic in there").clone()
    }

    pub fn text(&self) -> String {
        self.lines().iter().map(|line| format!("{line}\n")).collect()
    }

    fn join(&mut self) {
        self.reader.take().into_iter().for_each(|reader| reader.join().expect("it does not panic"));
    }
}

/// Whether there is anything to draw with; says so where there is not.
pub fn has_gpu() -> bool {
    match mullion_client::gpu::Gpu::open(mullion_client::gpu::GpuOptions::default()) {
        Ok(_) => true,
        Err(error) => {
            println!("skipped: {error}");
            false
        }
    }
}

/// Where a `serve` listens, from what it prints.
pub fn address_of(serve: &mut Process) -> String {
    let mut address = None;
    serve.until("address", Duration::from_secs(60), |process| {
        let line = process.out.lines().into_iter().find(|line| line.starts_with("serving "));
        address = line.and_then(|line| Some(line.rsplit_once(" on ")?.1.to_owned()));
        assert!(address.is_some() || process.is_running(), "it ended early: {}", process.err.text());
        address.is_some()
    });
    address.expect("it was just found")
}
