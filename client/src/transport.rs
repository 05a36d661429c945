//! What carries the bytes of a connection. Everything else of a node reads and writes without knowing.

use std::io;

use mullion_common::wire::OPENING_LIMIT;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;

/// A connection to a master.
pub(crate) struct Stream {
    /// What the master says.
    pub reader: Reader,
    /// What it is told.
    pub writer: Writer,
}

pub(crate) type Reader = Box<dyn AsyncRead + Send + Unpin>;
pub(crate) type Writer = Box<dyn AsyncWrite + Send + Unpin>;

/// Connects to a master, within [`OPENING_LIMIT`].
pub(crate) async fn connect(master: &str) -> io::Result<Stream> {
    let too_slow = || io::Error::new(io::ErrorKind::TimedOut, format!("no answer in {} s", OPENING_LIMIT.as_secs()));
    timeout(OPENING_LIMIT, open(master)).await.map_err(|_| too_slow())?
}

async fn open(master: &str) -> io::Result<Stream> {
    let stream = TcpStream::connect(master).await?;
    stream.set_nodelay(true)?;
    let (reader, writer) = stream.into_split();
    Ok(Stream { reader: Box::new(reader), writer: Box::new(writer) })
}
