//! Where connections come from, and how a standby makes one: TCP, unless a simulation or a tunnel takes its place.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};

/// What a peer says.
pub type Reader = Box<dyn AsyncRead + Send + Unpin>;
/// What a peer is told.
pub type Writer = Box<dyn AsyncWrite + Send + Unpin>;

/// Both directions of a connection. Neither waits for the other, and to drop both ends it.
pub struct Socket {
    /// What the peer says.
    pub reader: Reader,
    /// What it is told; without delay.
    pub writer: Writer,
}

impl From<TcpStream> for Socket {
    fn from(stream: TcpStream) -> Self {
        let _ = stream.set_nodelay(true); // it is gone already: who reads it will find out
        let (reader, writer) = stream.into_split();
        Self { reader: Box::new(reader), writer: Box::new(writer) }
    }
}

/// Where peers' connections come from.
pub trait Listener: Send + Sync {
    /// The next connection, and from where it is. May be dropped at any time without a connection getting lost.
    ///
    /// # Errors
    /// When there is none now; the next may come all the same.
    fn accept(&self) -> impl Future<Output = io::Result<(Socket, SocketAddr)>> + Send;

    /// The port at which others reach it.
    ///
    /// # Errors
    /// When the network does not tell.
    fn port(&self) -> io::Result<u16>;
}

impl Listener for TcpListener {
    async fn accept(&self) -> io::Result<(Socket, SocketAddr)> {
        let (stream, address) = Self::accept(self).await?;
        Ok((stream.into(), address))
    }

    fn port(&self) -> io::Result<u16> {
        Ok(self.local_addr()?.port())
    }
}

/// A connection that is being made.
pub type Connecting = Pin<Box<dyn Future<Output = io::Result<Socket>> + Send>>;

/// How a standby reaches its master. TCP by default.
#[derive(Clone)]
pub struct Connector(Arc<dyn Fn(String) -> Connecting + Send + Sync>);

impl Connector {
    /// By what is called with the master's host and port.
    pub fn new(connect: impl Fn(String) -> Connecting + Send + Sync + 'static) -> Self {
        Self(Arc::new(connect))
    }

    pub(super) async fn connect(&self, master: &str) -> io::Result<Socket> {
        (self.0)(master.to_owned()).await
    }
}

impl Default for Connector {
    fn default() -> Self {
        Self::new(|master| Box::pin(async move { Ok(TcpStream::connect(master).await?.into()) }))
    }
}

impl fmt::Debug for Connector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Connector")
    }
}
