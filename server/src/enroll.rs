//! Makes the identities of a wall: an authority of its own, and certificates for its masters, its nodes and its spares.
//!
//! A certificate proves to be signed by the authority and says whom it is for. That of a node or a spare serves the connecting side only: it
//! cannot answer as the master. A master's serves both: a standby connects to the master that it may follow. Keys are ECDSA over P-256.
//! The only user of rcgen.

use std::time::{Duration, SystemTime};

use mullion_common::identity::{Bearer, CertificateDer, IdentityError, parse_certificate};
use mullion_common::scene::ChunkHash;
use rcgen::{
    BasicConstraints, Certificate, CertificateParams, CertifiedIssuer, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose, PublicKeyData, SanType, date_time_ymd,
};
use thiserror::Error;

/// How long a certificate is valid. A wall outlives its installers; who is to be shut out is taken off the wall file.
pub const VALID_FOR: Duration = Duration::from_secs(10 * 365 * 24 * 60 * 60);
/// How far the clocks of a wall's machines may be behind.
pub const CLOCK_SLACK: Duration = Duration::from_secs(24 * 60 * 60);

/// Signs the certificates of one wall.
pub struct Authority {
    issuer: Issuer<'static, KeyPair>,
    certificate: CertificateDer<'static>,
    certificate_pem: String,
}

impl Authority {
    /// A new one.
    ///
    /// # Errors
    /// When the system gives no random numbers.
    pub fn new(now: SystemTime) -> Result<Self, EnrollError> {
        let key = KeyPair::generate()?;
        let authority = CertifiedIssuer::self_signed(authority_parameters(&key, now), key)?;
        let certificate_pem = authority.pem();
        // The key moves out by its text: an issuer that also knows its certificate does not give it back.
        Self::read(&certificate_pem, &authority.key().serialize_pem())
    }

    /// The one that wrote these two files.
    ///
    /// # Errors
    /// When one is not what it should be, or they do not belong together.
    pub fn read(certificate_pem: &str, key_pem: &str) -> Result<Self, EnrollError> {
        let key = KeyPair::from_pem(key_pem)?;
        let certificate = parse_certificate(certificate_pem)?;
        let public = key.der_bytes();
        if !certificate.windows(public.len()).any(|part| part == public) {
            return Err(EnrollError::OtherKey);
        }
        // Only name and key count when it signs; both follow from the key.
        let issuer = Issuer::new(authority_parameters(&key, SystemTime::UNIX_EPOCH), key);
        Ok(Self { issuer, certificate, certificate_pem: certificate_pem.to_owned() })
    }

    /// Its certificate.
    pub fn certificate(&self) -> &CertificateDer<'static> {
        &self.certificate
    }

    /// Its certificate, as text.
    pub fn certificate_pem(&self) -> &str {
        &self.certificate_pem
    }

    /// Its key, as text. Whoever has it can be anyone on the wall.
    pub fn key_pem(&self) -> String {
        self.issuer.key().serialize_pem()
    }

    /// The text of a new identity file.
    ///
    /// # Errors
    /// When the system gives no random numbers.
    pub fn issue(&self, bearer: &Bearer, now: SystemTime) -> Result<String, EnrollError> {
        let key = KeyPair::generate()?;
        use ExtendedKeyUsagePurpose::{ClientAuth, ServerAuth};
        let (usages, name) = match bearer {
            Bearer::Master => (vec![ServerAuth, ClientAuth], "Mullion master".to_owned()),
            Bearer::Node(node) => (vec![ClientAuth], format!("Mullion node {}", node.name)),
            Bearer::Spare(name) => (vec![ClientAuth], format!("Mullion spare {name}")),
        };
        let mut parameters = parameters(&name, now);
        parameters.is_ca = IsCa::ExplicitNoCa;
        parameters.use_authority_key_identifier_extension = true;
        parameters.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        parameters.extended_key_usages = usages;
        for name in bearer.names() {
            parameters.subject_alt_names.push(SanType::URI(name.try_into()?));
        }
        let certificate: Certificate = parameters.signed_by(&key, &self.issuer)?;
        Ok([certificate.pem(), key.serialize_pem(), self.certificate_pem.clone()].concat())
    }
}

fn authority_parameters(key: &KeyPair, now: SystemTime) -> CertificateParams {
    // Named for its key, so that no two authorities are taken for each other.
    let number: String = ChunkHash::of(key.der_bytes()).0[..6].iter().map(|byte| format!("{byte:02x}")).collect();
    let mut parameters = parameters(&format!("Mullion wall authority {number}"), now);
    parameters.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    parameters.key_usages = vec![KeyUsagePurpose::KeyCertSign];
    parameters
}

fn parameters(name: &str, now: SystemTime) -> CertificateParams {
    let mut parameters = CertificateParams::default();
    parameters.distinguished_name = DistinguishedName::new();
    parameters.distinguished_name.push(DnType::CommonName, name);
    let since_1970 = now.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default(); // a clock before 1970 is no clock
    let now = date_time_ymd(1970, 1, 1) + since_1970;
    (parameters.not_before, parameters.not_after) = (now - CLOCK_SLACK, now + VALID_FOR);
    parameters
}

/// Why no certificate was made.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum EnrollError {
    #[error("{0}")]
    NoCertificate(#[from] IdentityError),
    #[error("the authority's certificate and its key do not belong together")]
    OtherKey,
    #[error("cannot make a certificate: {0}")]
    Failed(#[from] rcgen::Error),
}
