//! Connections to a master: how they are made, kept, and written to.

use std::io;
use std::time::Duration;

use mullion_common::wire::{Bye, ByeCode, LENGTH_BYTES, SILENCE_LIMIT, WireError};
use tokio::io::{AsyncRead, AsyncWriteExt};
use tokio::sync::watch;
use tokio::time::{Instant, timeout};
use tokio_util::codec::{FramedRead, LengthDelimitedCodec};

use crate::node::{NodeError, NodeOptions};
use crate::transport::{Stream, Writer, connect, describe};

/// A connection that lasted so long was a good one: the next attempt comes soon.
const GOOD_CONNECTION: Duration = Duration::from_secs(5);

/// When to try again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reconnect {
    /// First pause; every further one is twice as long.
    pub first: Duration,
    /// Longest pause.
    pub longest: Duration,
    /// How long to go on without a connection; `None`: for ever.
    pub give_up_after: Option<Duration>,
}

impl Default for Reconnect {
    /// 100 ms, 1 s, for ever.
    fn default() -> Self {
        Self { first: Duration::from_millis(100), longest: Duration::from_secs(1), give_up_after: None }
    }
}

/// Why there is no connection, as it was told last: one line for each reason, not for each attempt.
#[derive(Debug, Default)]
struct Complaint(Option<String>);

impl Complaint {
    /// Whether the reason is to be told.
    fn is_new(&mut self, reason: &str) -> bool {
        let is_new = self.0.as_deref() != Some(reason);
        if is_new {
            self.0 = Some(reason.to_owned());
        }
        is_new
    }
}

/// How a connection ended.
pub(crate) enum End {
    /// Worth trying again.
    Lost(String),
    /// The master said goodbye.
    Bye(Bye),
    /// The painter's side is gone.
    NobodyThere,
}

/// Connects to the master, or one that stands by for it, and converses with it, again and again, until it ends the show, refuses the node
/// for good or all stay out of reach, or `nobody_there` comes to an end. Masters are tried in turn; a pause follows when all have been.
pub(crate) async fn keep_connected(
    options: &NodeOptions,
    nobody_there: impl AsyncFn(),
    converse: impl AsyncFn(Stream, &str) -> End,
) -> Result<(), NodeError> {
    let Reconnect { first, longest, give_up_after } = options.reconnect;
    let mut pause = first;
    let mut without = Instant::now();
    let mut complaint = Complaint::default();
    let mut turn = 0;
    loop {
        let master = options.masters.get(turn).map_or("", String::as_str);
        let mut was_good = false;
        let end = match connect(master, options).await {
            Ok(stream) => {
                let started = Instant::now();
                let end = converse(stream, master).await;
                was_good = started.elapsed() >= GOOD_CONNECTION;
                without = Instant::now();
                end
            }
            Err(error) => End::Lost(describe(&error)),
        };
        let last = match end {
            End::NobodyThere => return Ok(()),
            End::Bye(bye) if bye.code == ByeCode::EndOfShow => return Ok(()),
            End::Bye(bye) if !bye.code.is_retryable() => return Err(NodeError::Refused(bye)),
            End::Bye(bye) => bye.to_string(),
            End::Lost(reason) => reason,
        };
        if give_up_after.is_some_and(|limit| without.elapsed() >= limit) {
            let (master, seconds) = (options.masters.join(", "), without.elapsed().as_secs_f64());
            return Err(NodeError::Unreachable { master, seconds, last });
        }
        if was_good {
            pause = first;
            complaint = Complaint::default();
        }
        let node = &options.node;
        if complaint.is_new(&last) {
            tracing::warn!("node {node}: no connection to {master}: {last}; trying again until there is one");
        } else {
            tracing::debug!("node {node}: no connection to {master}: {last}; trying again in {} ms", pause.as_millis());
        }
        turn += 1;
        if turn < options.masters.len() {
            continue;
        }
        turn = 0;
        tokio::select! {
            biased;
            () = tokio::time::sleep(pause) => {}
            () = nobody_there() => return Ok(()),
        }
        pause = (pause * 2).min(longest);
    }
}

pub(crate) async fn stopped(stop: Option<watch::Receiver<bool>>) {
    if let Some(mut stop) = stop
        && stop.wait_for(|stop| *stop).await.is_ok()
    {
        return;
    }
    std::future::pending().await
}

pub(crate) fn framed<R: AsyncRead>(reader: R, cap: usize) -> FramedRead<R, LengthDelimitedCodec> {
    let mut builder = LengthDelimitedCodec::builder();
    builder.little_endian().length_field_length(LENGTH_BYTES).max_frame_length(cap).new_read(reader)
}

pub(crate) async fn write_message(
    writer: &mut Writer,
    buffer: &mut Vec<u8>,
    encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>,
) -> io::Result<()> {
    encode(buffer).map_err(io::Error::other)?;
    let too_slow = || io::Error::new(io::ErrorKind::TimedOut, "the master does not read");
    let write = async {
        writer.write_all(buffer).await?;
        writer.flush().await // nothing to do for a socket; what enciphers may still hold some of it
    };
    timeout(SILENCE_LIMIT, write).await.map_err(|_| too_slow())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_is_told_once_until_another_comes() {
        let mut complaint = Complaint::default();
        let told = ["refused", "refused", "refused", "a namesake", "a namesake", "refused"].map(|r| complaint.is_new(r));
        assert_eq!(told, [true, false, false, true, false, true]);
    }
}
