//! The processes that are a wall's nodes in a load test.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use mullion_common::wall::Node;
use serde::Serialize;

use crate::commands::load_nodes::Done;

/// How long processes may take to end after the show.
const END_WAIT: Duration = Duration::from_secs(10);

/// What nodes do in a load test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Clients {
    /// Take every frame, check every set, keep in step; draw nothing.
    Protocol,
    /// Draw without a window.
    Headless,
    /// Draw in windows.
    Real,
}

/// A process of some nodes.
struct Group {
    /// The nodes' places in the wall, and their names.
    nodes: std::ops::Range<usize>,
    names: Vec<String>,
    child: Child,
}

/// All of them; what still runs when this is dropped is ended.
pub struct ClientProcesses {
    program: PathBuf,
    clients: Clients,
    master: String,
    groups: Vec<Group>,
}

impl ClientProcesses {
    /// Starts nodes of a wall, the first of them, shared out to `processes` where nodes can share one.
    ///
    /// # Errors
    /// When a process cannot be started.
    pub fn start(clients: Clients, nodes: &[Node], master: &str, processes: usize) -> Result<Self> {
        let program = std::env::current_exe().context("cannot find this program to start nodes")?;
        let mut all = Self { program, clients, master: master.to_owned(), groups: Vec::new() };
        let each = match clients {
            Clients::Protocol => nodes.len().div_ceil(processes),
            Clients::Headless | Clients::Real => 1,
        };
        let name = |node: &Node| node.name.clone();
        for (nodes, start) in nodes.chunks(each).zip((0..).step_by(each)) {
            let names: Vec<String> = nodes.iter().map(name).collect();
            let child = all.spawn(&names)?;
            all.groups.push(Group { nodes: start..start + nodes.len(), names, child });
        }
        Ok(all)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.groups.len()
    }

    /// Which nodes of the wall a process is.
    pub fn nodes(&self, process: usize) -> std::ops::Range<usize> {
        self.groups[process].nodes.clone()
    }

    /// Ends a process as a machine that loses its power.
    ///
    /// # Errors
    /// When the system does not let it.
    pub fn kill(&mut self, process: usize) -> Result<()> {
        let child = &mut self.groups[process].child;
        child.kill().context("cannot end a node")?;
        child.wait().context("cannot end a node").map(drop)
    }

    /// Starts a process anew that was ended.
    ///
    /// # Errors
    /// When it cannot be started.
    pub fn restart(&mut self, process: usize) -> Result<()> {
        self.groups[process].child = self.spawn(&self.groups[process].names)?;
        Ok(())
    }

    /// Stops a process in its tracks, as a machine that hangs, or lets it go on.
    ///
    /// # Errors
    /// When the system does not let it, or knows no such thing.
    pub fn hang(&self, process: usize, is_hung: bool) -> Result<()> {
        #[cfg(unix)]
        {
            use rustix::process::{Pid, Signal, kill_process};
            let pid = Pid::from_child(&self.groups[process].child);
            kill_process(pid, if is_hung { Signal::STOP } else { Signal::CONT }).context("cannot stop a node")
        }
        #[cfg(not(unix))]
        anyhow::bail!("this system cannot stop process {process} (hung: {is_hung})")
    }

    fn spawn(&self, names: &[String]) -> Result<Child> {
        let mut command = Command::new(&self.program);
        match self.clients {
            Clients::Protocol => command.arg("load-nodes"),
            Clients::Headless | Clients::Real => command.args(["tile", "--give-up-after", "5", "--cache-mib", "0"]),
        };
        command.args(["--master", &self.master]).args(names);
        if self.clients == Clients::Headless {
            command.args(["--headless", "loadtest"]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().context("cannot start a node")
    }

    /// Waits for all to end and adds up what they did since they were last started.
    ///
    /// # Errors
    /// When one does not end in time, or failed.
    pub fn finish(mut self) -> Result<Done> {
        let end = Instant::now() + END_WAIT;
        let mut sum = Done::default();
        for Group { names, child, .. } in &mut self.groups {
            let name = &names[0];
            while child.try_wait()?.is_none() {
                ensure!(Instant::now() < end, "node {name} has not ended {} s after the show", END_WAIT.as_secs());
                std::thread::sleep(Duration::from_millis(5));
            }
            let text = child.stdout.take().map(std::io::read_to_string).transpose()?.unwrap_or_default();
            if self.clients == Clients::Protocol {
                let done: Done = serde_json::from_str(&text).with_context(|| format!("the process of node {name} failed"))?;
                sum.add(&done);
            }
        }
        Ok(sum)
    }
}

impl Drop for ClientProcesses {
    fn drop(&mut self) {
        for Group { child, .. } in &mut self.groups {
            let _ = child.kill(); // ended already
            let _ = child.wait(); // nothing is left of it then
        }
    }
}
