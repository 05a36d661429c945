//! What carries the bytes of a connection: a socket, or TLS over one. Everything else of a node reads and writes without knowing.

use std::fmt;
use std::io;
use std::pin::Pin;
use std::sync::Arc;

use mullion_common::identity::{Bearer, IdentityFile};
use mullion_common::wire::OPENING_LIMIT;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::client::{Resumption, verify_server_cert_signed_by_trust_anchor};
use rustls::crypto::{WebPkiSupportedAlgorithms, ring, verify_tls12_signature, verify_tls13_signature};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::ParsedCertificate;
use rustls::version::TLS13;
use rustls::{
    AlertDescription, CertificateError, ClientConfig, DigitallySignedStruct, Error as TlsError, RootCertStore, SignatureScheme,
};
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
    /// From the node's identity file.
    ///
    /// # Errors
    /// When the file is the master's, or its parts do not belong together.
    pub fn new(identity: IdentityFile) -> Result<Self, SecurityError> {
        if identity.bearer == Bearer::Master {
            return Err(SecurityError::IsMaster);
        }
        let mut roots = RootCertStore::empty();
        roots.add(identity.authority)?;
        let provider = Arc::new(ring::default_provider());
        let verifier = MasterVerifier { roots, algorithms: provider.signature_verification_algorithms };
        let builder = ClientConfig::builder_with_provider(provider).with_protocol_versions(&[&TLS13])?;
        // "Dangerous" is to check by other rules than a browser's. These are stricter: one authority, and the role of master.
        let builder = builder.dangerous().with_custom_certificate_verifier(Arc::new(verifier));
        let mut config = builder.with_client_auth_cert(vec![identity.certificate], identity.key)?;
        config.enable_sni = false; // the master is known by its role, wherever it runs
        config.resumption = Resumption::disabled();
        Ok(Self(TlsConnector::from(Arc::new(config))))
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
    #[error("is for the master: a node needs the nodes/NAME.pem that `mullion enroll` wrote")]
    IsMaster,
    #[error("cannot be used: {0}")]
    Tls(#[from] TlsError),
}

/// Takes a certificate for the master's if the wall's authority signed it for that role, whatever the master's address is.
#[derive(Debug)]
struct MasterVerifier {
    roots: RootCertStore,
    algorithms: WebPkiSupportedAlgorithms,
}

impl ServerCertVerifier for MasterVerifier {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, TlsError> {
        let parsed = ParsedCertificate::try_from(end_entity)?;
        verify_server_cert_signed_by_trust_anchor(&parsed, &self.roots, intermediates, now, self.algorithms.all)?;
        match Bearer::of_certificate(end_entity) {
            Ok(Bearer::Master) => Ok(ServerCertVerified::assertion()),
            _ => Err(CertificateError::ApplicationVerificationFailure.into()),
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, TlsError> {
        verify_tls12_signature(message, certificate, signed, &self.algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, TlsError> {
        verify_tls13_signature(message, certificate, signed, &self.algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.algorithms.supported_schemes()
    }
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
            // Neither sent nor checked, but TLS wants one.
            let name = ServerName::try_from("master").map_err(io::Error::other)?;
            let whole = tokio::io::join(stream.reader, stream.writer);
            let (reader, writer) = tokio::io::split(connector.connect(name, whole).await?);
            Ok(Stream { reader: Box::new(reader), writer: Box::new(writer) })
        }
    }
}

/// What ended a connection, for people.
pub(crate) fn describe(error: &io::Error) -> String {
    const REENROLL: &str = "copy the files of one `mullion enroll` to the master and all nodes";
    match error.get_ref().and_then(|inner| inner.downcast_ref::<TlsError>()) {
        None if error.kind() == io::ErrorKind::UnexpectedEof => "the master closed the connection".into(),
        None => error.to_string(),
        Some(TlsError::InvalidMessage(_)) => {
            "the master does not speak TLS: start it with --identity master.pem, or this node without --identity".into()
        }
        Some(TlsError::InvalidCertificate(fault)) => describe_certificate(fault, REENROLL),
        Some(TlsError::AlertReceived(alert)) => match alert {
            AlertDescription::UnknownCA | AlertDescription::DecryptError | AlertDescription::BadCertificate => {
                format!("the master does not take this node's certificate, which is of another authority: {REENROLL}")
            }
            AlertDescription::CertificateExpired => {
                "the master says that this node's certificate is not valid at this time: set both clocks, or enroll again".into()
            }
            other => format!("the master ended the TLS handshake: {other:?}"),
        },
        Some(other) => format!("TLS: {other}"),
    }
}

fn describe_certificate(fault: &CertificateError, reenroll: &str) -> String {
    match fault {
        CertificateError::UnknownIssuer | CertificateError::BadSignature => {
            format!("the master's certificate is of another authority than this node's: {reenroll}")
        }
        CertificateError::Expired
        | CertificateError::ExpiredContext { .. }
        | CertificateError::NotValidYet
        | CertificateError::NotValidYetContext { .. } => {
            format!("the master's certificate is not valid at this time ({fault}): set this machine's clock, or enroll again")
        }
        CertificateError::InvalidPurpose
        | CertificateError::InvalidPurposeContext { .. }
        | CertificateError::ApplicationVerificationFailure => {
            "who answers is not the master: its certificate is not for that role".into()
        }
        other => format!("the master's certificate cannot be believed: {other}"),
    }
}
