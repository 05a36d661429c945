//! How whoever connects to a master knows it, and is known to it: shared by nodes and by masters that stand by. Data for a TLS library; no
//! sockets here.

use std::io;
use std::sync::Arc;

use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::client::{Resumption, verify_server_cert_signed_by_trust_anchor};
use rustls::crypto::{WebPkiSupportedAlgorithms, ring, verify_tls12_signature, verify_tls13_signature};
pub use rustls::pki_types::ServerName;
use rustls::pki_types::{CertificateDer, UnixTime};
use rustls::server::ParsedCertificate;
use rustls::version::TLS13;
use rustls::{AlertDescription, CertificateError, DigitallySignedStruct, RootCertStore, SignatureScheme};
pub use rustls::{ClientConfig, Error as TlsError};

use crate::identity::{Bearer, IdentityFile};

/// For connections to the master of a wall, on which the bearer of this identity shows it.
///
/// # Errors
/// When the identity's parts do not belong together.
pub fn to_master(identity: &IdentityFile) -> Result<ClientConfig, TlsError> {
    let mut roots = RootCertStore::empty();
    roots.add(identity.authority.clone())?;
    let provider = Arc::new(ring::default_provider());
    let verifier = MasterVerifier { roots, algorithms: provider.signature_verification_algorithms };
    let builder = ClientConfig::builder_with_provider(provider).with_protocol_versions(&[&TLS13])?;
    // "Dangerous" is to check by other rules than a browser's. These are stricter: one authority, and the role of master.
    let builder = builder.dangerous().with_custom_certificate_verifier(Arc::new(verifier));
    let mut config = builder.with_client_auth_cert(vec![identity.certificate.clone()], identity.key.clone_key())?;
    config.enable_sni = false; // the master is known by its role, wherever it runs
    config.resumption = Resumption::disabled();
    Ok(config)
}

/// A name for who is known by its role: neither sent nor checked, but TLS wants one.
///
/// # Errors
/// Never, for this name.
pub fn name_of_master() -> io::Result<ServerName<'static>> {
    ServerName::try_from("master").map_err(io::Error::other)
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

/// What ended a connection, for people.
pub fn describe(error: &io::Error) -> String {
    const REENROLL: &str = "copy the files of one `mullion enroll` to all masters and nodes";
    match error.get_ref().and_then(|inner| inner.downcast_ref::<TlsError>()) {
        None if error.kind() == io::ErrorKind::UnexpectedEof => "the master closed the connection".into(),
        None => error.to_string(),
        Some(TlsError::InvalidMessage(_)) => {
            "the master does not speak TLS: start it with --identity master.pem, or this side without --identity".into()
        }
        Some(TlsError::InvalidCertificate(fault)) => describe_certificate(fault, REENROLL),
        Some(TlsError::AlertReceived(alert)) => match alert {
            AlertDescription::UnknownCA | AlertDescription::DecryptError | AlertDescription::BadCertificate => {
                format!("the master does not take this side's certificate, which is of another authority: {REENROLL}")
            }
            AlertDescription::CertificateExpired => {
                "the master says that this side's certificate is not valid at this time: set both clocks, or enroll again".into()
            }
            AlertDescription::UnsupportedCertificate => {
                "the master does not take this side's certificate for what it is used for: make it anew with `mullion enroll --force`".into()
            }
            other => format!("the master ended the TLS handshake: {other:?}"),
        },
        Some(other) => format!("TLS: {other}"),
    }
}

fn describe_certificate(fault: &CertificateError, reenroll: &str) -> String {
    match fault {
        CertificateError::UnknownIssuer | CertificateError::BadSignature => {
            format!("the master's certificate is of another authority than this side's: {reenroll}")
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
