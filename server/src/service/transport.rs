//! What carries the bytes of a connection. Everything else in the service reads and writes without knowing.

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;

/// What a peer says.
pub(super) type Reader = Box<dyn AsyncRead + Send + Unpin>;
/// What a peer is told.
pub(super) type Writer = Box<dyn AsyncWrite + Send + Unpin>;

/// The socket itself: its halves share nothing, and none waits for the other.
pub(super) fn plain(stream: TcpStream) -> (Reader, Writer) {
    let (reader, writer) = stream.into_split();
    (Box::new(reader), Box::new(writer))
}
