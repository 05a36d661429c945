//! What carries the bytes of a connection: a socket, or TLS over one. Everything else in the service reads and writes without knowing.

use std::fmt;
use std::io;
use std::sync::Arc;

use mullion_common::identity::{Bearer, IdentityError, IdentityFile};
use mullion_common::tls;
use mullion_common::wire::{ALIVE_EVERY, Bye, ByeCode, OPENING_LIMIT, ToTile};
use rustls::crypto::ring;
use rustls::server::{NoServerSessionStorage, VerifierBuilderError, WebPkiClientVerifier};
use rustls::version::TLS13;
use rustls::{CertificateError, RootCertStore, ServerConfig};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::time::timeout;
use tokio_rustls::{TlsAcceptor, TlsConnector};

use super::network::{Connector, Reader, Socket, Writer};

/// The first byte that whoever speaks TLS sends. No greeting of ours is so short: it is the low byte of a length.
const TLS_HANDSHAKE: u8 = 22;

/// How connections to a master are secured.
#[derive(Clone, Debug, Default)]
pub enum Security {
    /// Not at all: whoever reaches the master and knows a node's name is that node.
    #[default]
    Plain,
    /// Both sides show certificates of the wall's authority.
    Tls(MasterTls),
}

/// What a master shows its nodes and other masters, and takes from them.
#[derive(Clone)]
pub struct MasterTls {
    acceptor: TlsAcceptor,
    /// For connections to other masters.
    connector: TlsConnector,
}

impl MasterTls {
    /// From the master's identity file.
    ///
    /// # Errors
    /// When the file is for no master, or its parts do not belong together.
    pub fn new(identity: IdentityFile) -> Result<Self, SecurityError> {
        if identity.bearer != Bearer::Master {
            return Err(SecurityError::NoMaster(identity.bearer));
        }
        let connector = TlsConnector::from(Arc::new(tls::to_master(&identity)?));
        let mut roots = RootCertStore::empty();
        roots.add(identity.authority)?;
        let provider = Arc::new(ring::default_provider());
        let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider)).build()?;
        let builder = ServerConfig::builder_with_provider(provider).with_protocol_versions(&[&TLS13])?;
        let builder = builder.with_client_cert_verifier(verifier);
        let mut config = builder.with_single_cert(vec![identity.certificate], identity.key)?;
        // A resumed session would stand for a certificate that was shown long ago.
        config.session_storage = Arc::new(NoServerSessionStorage {});
        config.send_tls13_tickets = 0;
        Ok(Self { acceptor: TlsAcceptor::from(Arc::new(config)), connector })
    }
}

impl fmt::Debug for MasterTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("MasterTls")
    }
}

/// Why an identity does not serve a master.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum SecurityError {
    #[error(
        "is for {0}: a master needs the master.pem, and one that stands by the standbys/NAME.pem, that `mullion enroll` wrote"
    )]
    NoMaster(Bearer),
    #[error("cannot be used: {0}")]
    Tls(#[from] rustls::Error),
    #[error("names an authority that cannot be used: {0}")]
    Authority(#[from] VerifierBuilderError),
}

/// A connection that may say who it is.
pub(super) struct Admitted {
    pub reader: Reader,
    pub writer: Writer,
    /// Whom its certificate is for.
    pub identity: Option<Bearer>,
}

/// Does what comes before the first message, within [`OPENING_LIMIT`].
///
/// # Errors
/// With the reason, where the connection is of no use. It is closed by then.
pub(super) async fn admit(socket: Socket, security: &Security) -> Result<Admitted, String> {
    match security {
        Security::Plain => Ok(Admitted { reader: socket.reader, writer: socket.writer, identity: None }),
        Security::Tls(MasterTls { acceptor, .. }) => match timeout(OPENING_LIMIT, shake_hands(socket, acceptor)).await {
            Ok(result) => result,
            Err(_) => Err(format!("no TLS handshake within {} s", OPENING_LIMIT.as_secs())),
        },
    }
}

/// Connects to another master. The caller bounds the time.
pub(super) async fn connect(master: &str, (connector, security): (&Connector, &Security)) -> io::Result<Socket> {
    let socket = connector.connect(master).await?;
    match security {
        Security::Plain => Ok(socket),
        Security::Tls(MasterTls { connector, .. }) => {
            let whole = tokio::io::join(socket.reader, socket.writer);
            let (reader, writer) = tokio::io::split(connector.connect(tls::name_of_master()?, whole).await?);
            Ok(Socket { reader: Box::new(reader), writer: Box::new(writer) })
        }
    }
}

async fn shake_hands(socket: Socket, acceptor: &TlsAcceptor) -> Result<Admitted, String> {
    let Socket { mut reader, writer } = socket;
    let mut first = [0];
    match reader.read(&mut first).await {
        Ok(1..) if first[0] != TLS_HANDSHAKE => {
            let _ = refuse_plainly(tokio::io::join(reader, writer)).await; // it is refused either way
            return Err("it does not speak TLS".into());
        }
        Ok(1..) => {}
        Ok(0) => return Err("it ended before it said anything".into()),
        Err(error) => return Err(error.to_string()),
    }
    let whole = io::Cursor::new(first).chain(reader);
    match acceptor.accept(tokio::io::join(whole, writer)).into_fallible().await {
        Ok(stream) => {
            let certificate = stream.get_ref().1.peer_certificates().and_then(<[_]>::first);
            let bearer = certificate.ok_or(IdentityError::NoBearer).and_then(Bearer::of_certificate);
            let Ok(identity) = bearer else { return Err("its certificate is of nobody on a wall".into()) };
            let (reader, writer) = tokio::io::split(stream);
            Ok(Admitted { reader: Box::new(reader), writer: Box::new(writer), identity: Some(identity) })
        }
        Err((error, stream)) => {
            let reason = describe(&error);
            let _ = end(stream).await; // it is refused either way
            Err(reason)
        }
    }
}

/// Who knows nothing of certificates reads this.
async fn refuse_plainly(mut stream: impl AsyncRead + AsyncWrite + Unpin) -> io::Result<()> {
    let reason = "this master takes peers with certificates only: start with --identity, and the file that `mullion enroll` wrote for this \
                  node, spare or standby";
    let mut bytes = Vec::new();
    ToTile::Bye(Bye::new(ByeCode::Refused, reason)).encode(&mut bytes).map_err(io::Error::other)?;
    stream.write_all(&bytes).await?;
    end(stream).await
}

/// A peer that is still writing must not lose our last words to a reset: reads on for a moment.
async fn end(mut stream: impl AsyncRead + AsyncWrite + Unpin) -> io::Result<()> {
    stream.shutdown().await?;
    let mut waste = [0; 1024];
    let drain = async { while matches!(stream.read(&mut waste).await, Ok(1..)) {} };
    let _ = timeout(ALIVE_EVERY, drain).await; // it had its moment
    Ok(())
}

fn describe(error: &io::Error) -> String {
    use rustls::Error as E;
    match error.get_ref().and_then(|inner| inner.downcast_ref::<E>()) {
        Some(E::NoCertificatesPresented) => "it showed no certificate".into(),
        Some(E::InvalidCertificate(CertificateError::UnknownIssuer | CertificateError::BadSignature)) => {
            "its certificate is not of this wall's authority".into()
        }
        Some(E::InvalidCertificate(fault)) => format!("its certificate is refused: {fault}"),
        Some(E::AlertReceived(alert)) => format!("it does not take this master's certificate ({alert:?})"),
        Some(E::InvalidMessage(_)) => "it does not speak TLS".into(),
        Some(other) => format!("TLS: {other}"),
        None => error.to_string(),
    }
}
