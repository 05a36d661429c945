//! What carries the bytes of a connection: a socket, or TLS over one. Everything else of a node reads and writes without knowing.

use std::fmt;
use std::io;
use std::pin::Pin;
use std::sync::Arc;

use mullion_common::identity::{Bearer, IdentityFile};
pub(crate) use mullion_common::tls::describe;
use mullion_common::tls::{self, TlsError};
use mullion_common::wire::OPENING_LIMIT;
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

use crate::node::NodeOptions;

/// Both directions of a connection to a master. Neither waits for the other, and to drop both ends it.
pub struct Stream {
    /// What the master says.
    pub reader: Reader,
    /// What it is told; without delay.
    pub writer: Writer,
}

/// What a master says.
pub type Reader = Box<dyn AsyncRead + Send + Unpin>;
/// What a master is told.
pub type Writer = Box<dyn AsyncWrite + Send + Unpin>;

/// A connection that is being made.
pub type Connecting = Pin<Box<dyn Future<Output = io::Result<Stream>> + Send>>;

/// How masters are reached: TCP by default, unless a simulation or a tunnel takes its place.
#[derive(Clone)]
pub struct Connector(Arc<dyn Fn(String) -> Connecting + Send + Sync>);

impl Connector {
    /// By what is called with a master's host and port.
    pub fn new(connect: impl Fn(String) -> Connecting + Send + Sync + 'static) -> Self {
        Self(Arc::new(connect))
    }
}

impl Default for Connector {
    fn default() -> Self {
        Self::new(|master| {
            Box::pin(async move {
                let stream = TcpStream::connect(master).await?;
                stream.set_nodelay(true)?;
                let (reader, writer) = stream.into_split();
                Ok(Stream { reader: Box::new(reader), writer: Box::new(writer) })
            })
        })
    }
}

impl fmt::Debug for Connector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Connector")
    }
}

/// How connections to a master are secured.
#[derive(Clone, Debug, Default)]
pub enum Security {
    /// Not at all.
    #[default]
    Plain,
    /// Both sides show certificates of the wall's authority.
    Tls(NodeTls),
}

/// What a node shows its master, and takes from it.
#[derive(Clone)]
pub struct NodeTls(TlsConnector);

impl NodeTls {
    /// From the identity file of a node or a spare.
    ///
    /// # Errors
    /// When the file is the master's, or its parts do not belong together.
    pub fn new(identity: IdentityFile) -> Result<Self, SecurityError> {
        if identity.bearer == Bearer::Master {
            return Err(SecurityError::IsMaster);
        }
        Ok(Self(TlsConnector::from(Arc::new(tls::to_master(&identity)?))))
    }
}

impl fmt::Debug for NodeTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("NodeTls")
    }
}

/// Why an identity does not serve a node.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum SecurityError {
    #[error("is for the master: a node needs the nodes/NAME.pem, and a spare the spares/NAME.pem, that `mullion enroll` wrote")]
    IsMaster,
    #[error("cannot be used: {0}")]
    Tls(#[from] TlsError),
}

/// Connects to one of a node's masters, within [`OPENING_LIMIT`], or sooner where there are others to try.
pub(crate) async fn connect(master: &str, options: &NodeOptions) -> io::Result<Stream> {
    let limit = options.patience().min(OPENING_LIMIT);
    let too_slow = || io::Error::new(io::ErrorKind::TimedOut, format!("no answer in {} s", limit.as_secs()));
    timeout(limit, open(master, options)).await.map_err(|_| too_slow())?
}

async fn open(master: &str, options: &NodeOptions) -> io::Result<Stream> {
    let Connector(connect) = &options.connector;
    let stream = connect(master.to_owned()).await?;
    match &options.security {
        Security::Plain => Ok(stream),
        Security::Tls(NodeTls(connector)) => {
            let whole = tokio::io::join(stream.reader, stream.writer);
            let (reader, writer) = tokio::io::split(connector.connect(tls::name_of_master()?, whole).await?);
            Ok(Stream { reader: Box::new(reader), writer: Box::new(writer) })
        }
    }
}
