//! One connection: reads what a peer says, writes what waits for it, serves its chunks.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use futures_util::StreamExt;
use mullion_common::identity::Bearer;
use mullion_common::scene::ChunkHash;
use mullion_common::wire::{
    ALIVE_EVERY, ChunkReply, LENGTH_BYTES, MAX_CHUNK_REQUEST_BYTES, MAX_OPENING_BYTES, MAX_TO_MASTER_BYTES, MAX_WANTED, Piece,
    SILENCE_LIMIT, Want, WireError,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::sync::{Notify, mpsc, oneshot};
use tokio::time::timeout;
use tokio_util::codec::{FramedRead, LengthDelimitedCodec, LengthDelimitedCodecError};

use super::blobs::Blobs;
use super::mailbox::Mailbox;
use super::network::{Reader, Socket, Writer};
use super::transport::{Admitted, Security, admit};
use crate::master::PeerId;

/// Bytes of a blob sent at a time. The loop that sends frames waits for about one of these per busy chunk connection.
const PIECE_BYTES: usize = 64 << 10;
const _: () = assert!(PIECE_BYTES <= mullion_common::wire::MAX_PIECE_BYTES, "a piece fits its cap");

/// What the master makes of a connection after its first message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Control,
    Chunks,
    Refused,
}

/// From a connection to the master's loop.
pub(super) enum Event {
    /// It has shown a certificate that says whom it is for.
    Identity {
        peer: PeerId,
        identity: Bearer,
    },
    /// It is closed before it could say anything.
    NotAdmitted {
        peer: PeerId,
        reason: String,
    },
    Opening {
        peer: PeerId,
        body: Vec<u8>,
        role: oneshot::Sender<Role>,
    },
    Body {
        peer: PeerId,
        body: Vec<u8>,
    },
    Fault {
        peer: PeerId,
        error: WireError,
    },
    Ended {
        peer: PeerId,
    },
    /// Another master that was asked drives the wall, and where it is; or it does not.
    Rival {
        drives: Option<String>,
    },
}

pub(super) struct Connection {
    pub peer: PeerId,
    pub mailbox: Arc<Mailbox>,
    pub events: mpsc::Sender<Event>,
    pub blobs: Arc<Blobs>,
    pub chunk_bytes: Arc<AtomicU64>,
    /// Time spent writing mail, nanoseconds.
    pub write_ns: Arc<AtomicU64>,
}

pub(super) type Bodies = FramedRead<Reader, LengthDelimitedCodec>;

impl Connection {
    /// Serves the connection until either side ends it.
    pub async fn run(self, socket: Socket, security: Security) {
        match admit(socket, &security).await {
            Ok(admitted) => self.converse(admitted).await,
            Err(reason) => self.tell(Event::NotAdmitted { peer: self.peer, reason }).await,
        }
        self.tell(Event::Ended { peer: self.peer }).await;
    }

    async fn tell(&self, event: Event) {
        let _ = self.events.send(event).await; // the loop is gone: nobody to tell
    }

    async fn converse(&self, Admitted { reader, writer, identity }: Admitted) {
        if let Some(identity) = identity {
            self.tell(Event::Identity { peer: self.peer, identity }).await;
        }
        let mut bodies = framed(reader, MAX_OPENING_BYTES);
        let writer = tokio::sync::Mutex::new(writer);
        tokio::select! {
            biased;
            _ = self.write_mail(&writer) => {
                // A peer that is still writing must not lose our last words to a reset: read on for a moment.
                let _ = writer.lock().await.shutdown().await; // gone already: nothing to shut
                let mut reader = bodies.into_inner();
                let _ = timeout(ALIVE_EVERY, drain(&mut reader)).await; // it had its moment
            }
            () = self.listen(&mut bodies, &writer) => {}
        }
    }

    /// Returns once the mailbox is closed and empty, or the peer does not take what is sent.
    async fn write_mail(&self, writer: &tokio::sync::Mutex<Writer>) -> io::Result<()> {
        while let Some(message) = self.mailbox.next().await {
            let mut writer = writer.lock().await;
            let before = Instant::now();
            write_all(&mut writer, &message.bytes).await?;
            self.write_ns.fetch_add(before.elapsed().as_nanos() as u64, Ordering::Relaxed);
            drop(writer);
            self.mailbox.spent(message.bytes);
        }
        Ok(())
    }

    /// Returns once the peer has ended the connection.
    async fn listen(&self, bodies: &mut Bodies, writer: &tokio::sync::Mutex<Writer>) {
        let Some(body) = self.next_body(bodies, MAX_OPENING_BYTES).await else { return };
        let (role, decided) = oneshot::channel();
        self.pass_on(Event::Opening { peer: self.peer, body, role }).await;
        match decided.await {
            Ok(Role::Control) => {
                bodies.decoder_mut().set_max_frame_length(MAX_TO_MASTER_BYTES);
                while let Some(body) = self.next_body(bodies, MAX_TO_MASTER_BYTES).await {
                    self.pass_on(Event::Body { peer: self.peer, body }).await;
                }
            }
            Ok(Role::Chunks) => {
                bodies.decoder_mut().set_max_frame_length(MAX_CHUNK_REQUEST_BYTES);
                self.serve_chunks(bodies, writer).await;
            }
            Ok(Role::Refused) | Err(_) => std::future::pending().await, // the goodbye is being written
        }
    }

    /// `None` at the end of the stream. What is no message is reported, and then nothing more is read.
    async fn next_body(&self, bodies: &mut Bodies, cap: usize) -> Option<Vec<u8>> {
        match bodies.next().await {
            Some(Ok(body)) => Some(body.to_vec()),
            Some(Err(error)) if error.get_ref().is_some_and(|e| e.is::<LengthDelimitedCodecError>()) => {
                // The codec keeps the length to itself.
                self.report(WireError::TooLong { cap }).await
            }
            _ => None,
        }
    }

    /// Tells the loop what came in. Where that is gone the show is over: the goodbye is being written, and nothing is read any more.
    async fn pass_on(&self, event: Event) {
        if self.events.send(event).await.is_err() {
            std::future::pending::<()>().await;
        }
    }

    async fn report(&self, error: WireError) -> ! {
        self.pass_on(Event::Fault { peer: self.peer, error }).await;
        std::future::pending().await
    }

    async fn serve_chunks(&self, bodies: &mut Bodies, writer: &tokio::sync::Mutex<Writer>) {
        let wanted = Mutex::new(VecDeque::new());
        let more = Notify::new();
        tokio::select! {
            biased;
            () = self.read_wants(bodies, &wanted, &more) => {}
            _ = self.write_pieces(writer, &wanted, &more) => {}
        }
    }

    async fn read_wants(&self, bodies: &mut Bodies, wanted: &Mutex<VecDeque<ChunkHash>>, more: &Notify) {
        while let Some(body) = self.next_body(bodies, MAX_CHUNK_REQUEST_BYTES).await {
            let added = Want::decode(&body).and_then(|want| {
                let mut wanted = wanted.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                let open = wanted.len() + want.hashes.len();
                if open > MAX_WANTED {
                    return Err(WireError::Limit { what: "wanted blobs", value: open as u64, cap: MAX_WANTED as u64 });
                }
                wanted.extend(want.hashes);
                Ok(())
            });
            match added {
                Ok(()) => more.notify_one(),
                Err(error) => self.report(error).await,
            }
        }
    }

    async fn write_pieces(
        &self,
        writer: &tokio::sync::Mutex<Writer>,
        wanted: &Mutex<VecDeque<ChunkHash>>,
        more: &Notify,
    ) -> io::Result<()> {
        let mut buffer = Vec::new();
        loop {
            let next = wanted.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop_front();
            let Some(hash) = next else {
                more.notified().await;
                continue;
            };
            let Some(blob) = self.blobs.get(hash) else {
                ChunkReply::Absent { hash }.encode(&mut buffer).map_err(io::Error::other)?;
                write_all(&mut *writer.lock().await, &buffer).await?;
                continue;
            };
            let (blob, mut offset) = (blob.bytes(), 0);
            loop {
                let bytes = &blob[offset..blob.len().min(offset + PIECE_BYTES)];
                let piece = Piece { hash, offset: offset as u64, total: blob.len() as u64, bytes };
                ChunkReply::Piece(piece).encode(&mut buffer).map_err(io::Error::other)?;
                write_all(&mut *writer.lock().await, &buffer).await?;
                self.chunk_bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
                tokio::task::yield_now().await; // everyone else's turn: frames, and other nodes' pieces
                offset += bytes.len();
                if offset == blob.len() {
                    break;
                }
            }
        }
    }
}

/// Bodies of messages, none longer than `cap`.
pub(super) fn framed(reader: Reader, cap: usize) -> Bodies {
    let mut builder = LengthDelimitedCodec::builder();
    builder.little_endian().length_field_length(LENGTH_BYTES).max_frame_length(cap).new_read(reader)
}

pub(super) async fn write_all(writer: &mut Writer, bytes: &[u8]) -> io::Result<()> {
    let too_slow = || io::Error::new(io::ErrorKind::TimedOut, "the peer does not read");
    let write = async {
        writer.write_all(bytes).await?;
        writer.flush().await // nothing to do for a socket; what enciphers may still hold some of it
    };
    timeout(SILENCE_LIMIT, write).await.map_err(|_| too_slow())?
}

async fn drain(reader: &mut Reader) {
    let mut waste = [0; 4096];
    while matches!(reader.read(&mut waste).await, Ok(1..)) {}
}
