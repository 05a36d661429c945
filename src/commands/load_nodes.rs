//! `mullion load-nodes`: nodes of a wall that draw nothing, many in one process. `mullion loadtest` starts them.

use std::time::Duration;

use anyhow::{Result, anyhow};
use mullion_client::missing::WhenMissing;
use mullion_client::node::{Connector, NodeOptions, Reconnect, Security};
use mullion_client::protocol_node::{self, ProtocolReport};
use mullion_common::wire::Part;
use serde::{Deserialize, Serialize};
use tokio::task::LocalSet;

use crate::load::peak_bytes;
use crate::say::say;

/// Which nodes to be, of which master.
#[derive(clap::Args)]
pub struct Options {
    /// Names of the nodes.
    #[arg(required = true)]
    names: Vec<String>,
    /// Host and port of the master.
    #[arg(long)]
    master: String,
}

/// What the nodes of one process did, as a line of JSON on standard output.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Done {
    /// Frames applied.
    pub applied: u64,
    /// Frames shown.
    pub shown: u64,
    /// Connections made.
    pub connections: u64,
    /// Connections left because of what came.
    pub left: u64,
    /// Bytes of frames.
    pub frame_bytes: u64,
    /// Greatest uncertainty of a node's estimate of the master's clock, microseconds.
    pub uncertainty_us: u64,
    /// Greatest memory of the process, bytes; 0 where it cannot be told.
    pub peak_bytes: u64,
}

impl Done {
    /// Adds what another process did.
    pub fn add(&mut self, other: &Self) {
        self.applied += other.applied;
        self.shown += other.shown;
        self.connections += other.connections;
        self.left += other.left;
        self.frame_bytes += other.frame_bytes;
        self.uncertainty_us = self.uncertainty_us.max(other.uncertainty_us);
        self.peak_bytes += other.peak_bytes;
    }
}

/// Where the master is on this machine, it is gone if it does not answer for so long.
const GIVE_UP_AFTER: Duration = Duration::from_secs(5);

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let reconnect = Reconnect { give_up_after: Some(GIVE_UP_AFTER), ..Reconnect::default() };
    let reports = LocalSet::new().block_on(&runtime, async {
        let nodes = options.names.iter().map(|name| {
            let options = NodeOptions {
                masters: vec![options.master.clone()],
                connector: Connector::default(),
                part: Part::Own,
                node: name.clone(),
                credentials: None,
                security: Security::Plain,
                memory_bytes: 0,
                when_missing: WhenMissing::Hold,
                cache: None,
                reconnect,
                stop: None,
            };
            tokio::task::spawn_local(protocol_node::run(options))
        });
        let mut reports: Vec<ProtocolReport> = Vec::new();
        for node in nodes.collect::<Vec<_>>() {
            reports.push(node.await.map_err(|_| anyhow!("a node ended unexpectedly"))??);
        }
        Ok::<_, anyhow::Error>(reports)
    })?;
    let mut done = Done { peak_bytes: peak_bytes(), ..Done::default() };
    for report in reports {
        done.add(&Done {
            applied: report.applied,
            shown: report.shown,
            connections: report.connections.into(),
            left: report.left.into(),
            frame_bytes: report.frame_bytes,
            uncertainty_us: report.uncertainty.unwrap_or_default().as_micros() as u64,
            peak_bytes: 0,
        });
    }
    say!("{}", serde_json::to_string(&done)?);
    Ok(())
}
