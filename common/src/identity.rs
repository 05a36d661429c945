//! Who is who on a wall: what a certificate says of its bearer, and the files that hold one.
//!
//! A certificate names its bearer in its alternative names: `mullion:master`, `mullion:spare:NAME`, or `mullion:node:NAME` together with
//! `mullion:tiles:NAME,NAME`. A master that stands by is a master. Names of nodes and tiles hold neither commas nor anything else that such
//! a name must not hold. Who signed a certificate is checked where it is used; nothing here believes or disbelieves.
//!
//! An identity file is PEM: a bearer's certificate and key, and the certificate of the wall's authority. Each machine needs one such file.

use std::fmt;

pub use rustls_pki_types::CertificateDer;
use rustls_pki_types::PrivateKeyDer;
use rustls_pki_types::pem::PemObject;
use thiserror::Error;
use webpki::EndEntityCert;

use crate::wall::{Node, Wall};

/// Most bytes of an identity file.
pub const MAX_IDENTITY_BYTES: u64 = 256 << 10;

const MASTER: &str = "mullion:master";
const NODE: &str = "mullion:node:";
const SPARE: &str = "mullion:spare:";
const TILES: &str = "mullion:tiles:";

/// Whom a certificate is for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Bearer {
    /// A master of a wall, or one that stands by.
    Master,
    /// A node.
    Node(NodeIdentity),
    /// Whoever stands in for missing nodes, by its own name.
    Spare(String),
}

impl fmt::Display for Bearer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Master => f.write_str("the master"),
            Self::Node(node) => write!(f, "node {:?}", node.name),
            Self::Spare(name) => write!(f, "spare {name:?}"),
        }
    }
}

/// A node and the tiles that it may draw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeIdentity {
    /// Its name in the wall.
    pub name: String,
    /// Names of its tiles, sorted.
    pub tiles: Vec<String>,
}

impl NodeIdentity {
    /// What a wall says of a node of its own.
    pub fn of(wall: &Wall, node: &Node) -> Self {
        let mut tiles: Vec<String> = node.tiles.iter().map(|tile| wall.tiles()[usize::from(tile.0)].name.clone()).collect();
        tiles.sort();
        Self { name: node.name.clone(), tiles }
    }
}

impl Bearer {
    /// The names that stand in a certificate of this bearer.
    pub fn names(&self) -> Vec<String> {
        match self {
            Self::Master => vec![MASTER.to_owned()],
            Self::Spare(name) => vec![format!("{SPARE}{name}")],
            Self::Node(node) => vec![format!("{NODE}{}", node.name), format!("{TILES}{}", node.tiles.join(","))],
        }
    }

    /// What a certificate says of its bearer. Does not check who signed it.
    ///
    /// # Errors
    /// When it is no certificate, or none of a wall.
    pub fn of_certificate(certificate: &CertificateDer<'_>) -> Result<Self, IdentityError> {
        let certificate = EndEntityCert::try_from(certificate).map_err(|error| IdentityError::Certificate(error.to_string()))?;
        Self::from_names(certificate.valid_uri_names())
    }

    /// Exactly one role, and one list of tiles if it is a node's.
    fn from_names<'a>(names: impl Iterator<Item = &'a str>) -> Result<Self, IdentityError> {
        let (mut is_master, mut nodes, mut lists, mut spares) = (false, Vec::new(), Vec::new(), Vec::new());
        for name in names {
            if name == MASTER {
                is_master = true;
            } else if let Some(node) = name.strip_prefix(NODE) {
                nodes.push(node);
            } else if let Some(list) = name.strip_prefix(TILES) {
                lists.push(list);
            } else if let Some(spare) = name.strip_prefix(SPARE) {
                spares.push(spare);
            }
        }
        match (is_master, &nodes[..], &lists[..], &spares[..]) {
            (true, [], [], []) => Ok(Self::Master),
            (false, [], [], [name]) => Ok(Self::Spare((*name).to_owned())),
            (false, [name], [list], []) => {
                let mut tiles: Vec<String> = list.split(',').filter(|tile| !tile.is_empty()).map(str::to_owned).collect();
                tiles.sort();
                Ok(Self::Node(NodeIdentity { name: (*name).to_owned(), tiles }))
            }
            _ => Err(IdentityError::NoBearer),
        }
    }
}

/// What an identity file holds.
#[derive(Debug)]
pub struct IdentityFile {
    /// Whom it is for.
    pub bearer: Bearer,
    /// The bearer's certificate.
    pub certificate: CertificateDer<'static>,
    /// Its key.
    pub key: PrivateKeyDer<'static>,
    /// The certificate of the wall's authority, the only one whose signatures count.
    pub authority: CertificateDer<'static>,
}

impl IdentityFile {
    /// Reads the text of an identity file.
    ///
    /// # Errors
    /// When it is none, or part of one.
    pub fn parse(pem: &[u8]) -> Result<Self, IdentityError> {
        let certificates = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>();
        let certificates = certificates.map_err(|error| IdentityError::Pem(error.to_string()))?;
        let Ok([certificate, authority]) = <[_; 2]>::try_from(certificates) else {
            return Err(IdentityError::Incomplete { what: "a certificate and that of the wall's authority" });
        };
        let key = PrivateKeyDer::from_pem_slice(pem).map_err(|_| IdentityError::Incomplete { what: "a private key" })?;
        Ok(Self { bearer: Bearer::of_certificate(&certificate)?, certificate, key, authority })
    }
}

/// Reads the first certificate of a PEM file.
///
/// # Errors
/// When there is none.
pub fn parse_certificate(pem: &str) -> Result<CertificateDer<'static>, IdentityError> {
    CertificateDer::from_pem_slice(pem.as_bytes()).map_err(|error| IdentityError::Certificate(error.to_string()))
}

/// Why something is no identity.
#[derive(Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum IdentityError {
    #[error("is no identity file: {0}")]
    Pem(String),
    #[error("is no identity file: it must hold {what}; name a file that `mullion enroll` wrote, as master.pem or nodes/NAME.pem")]
    Incomplete { what: &'static str },
    #[error("is no certificate: {0}")]
    Certificate(String),
    #[error("the certificate names neither a wall's master nor one of its nodes or spares")]
    NoBearer,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(name: &str, tiles: &[&str]) -> Bearer {
        Bearer::Node(NodeIdentity { name: name.into(), tiles: tiles.iter().map(|tile| (*tile).into()).collect() })
    }

    #[test]
    fn names_say_who_bears_them() {
        for bearer in [Bearer::Master, Bearer::Spare("a-1".into()), node("left-1.a", &["t0x0", "t0x1"]), node("t0x0", &["t0x0"])]
        {
            let names = bearer.names();
            assert_eq!(Bearer::from_names(names.iter().map(String::as_str)), Ok(bearer));
        }
        let with_others = ["https://example.org", "mullion:tiles:b,a", "mullion:node:x"];
        assert_eq!(Bearer::from_names(with_others.into_iter()), Ok(node("x", &["a", "b"])));
    }

    #[test]
    fn two_roles_are_none() {
        let bad: [&[&str]; 8] = [
            &[],
            &["mullion:node:x"],
            &["mullion:tiles:x"],
            &["mullion:master", "mullion:node:x", "mullion:tiles:x"],
            &["mullion:node:x", "mullion:node:y", "mullion:tiles:x"],
            &["mullion:spare:x", "mullion:node:x", "mullion:tiles:x"],
            &["mullion:spare:x", "mullion:master"],
            &["mullion:spare:x", "mullion:spare:y"],
        ];
        for names in bad {
            assert_eq!(Bearer::from_names(names.iter().copied()), Err(IdentityError::NoBearer), "{names:?}");
        }
    }

    #[test]
    fn what_is_no_identity_file_says_so() {
        let garbage = IdentityFile::parse(b"what").map(|_| ()).unwrap_err();
        assert!(garbage.to_string().contains("mullion enroll"), "{garbage}");
        let cut = IdentityFile::parse(b"-----BEGIN CERTIFICATE-----\nMIIB\n").map(|_| ()).unwrap_err();
        assert!(cut.to_string().starts_with("is no identity file"), "{cut}");
    }
}
