//! Whether who greets is who it says it is.

use mullion_common::identity::{Bearer, NodeIdentity};
use mullion_common::wall::Wall;
use mullion_common::wire::{Bye, ByeCode};

use super::{Master, Peer, PeerId};

/// Whom a master believes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Admission {
    /// Everyone: a name is enough.
    #[default]
    ByName,
    /// Who has shown the certificate of that node and its tiles, of a spare, or of a master.
    ByCertificate,
}

impl Master {
    /// The same, but choosy.
    pub fn admitting(mut self, admission: Admission) -> Self {
        self.admission = admission;
        self
    }

    /// A connection has shown a certificate of the wall's authority, for this bearer.
    pub fn handle_identity(&mut self, peer: PeerId, shown: Bearer) {
        if let Some(Peer::Unnamed { identity, .. }) = self.peers.get_mut(&peer) {
            *identity = Some(shown);
        }
    }

    /// Whether a connection that has not said who it is may be what it claims to be.
    pub(super) fn admit(&self, peer: PeerId, claim: Claim<'_>) -> Result<(), Bye> {
        self.admission.check(self.shown_by(peer), claim, &self.wall)
    }

    /// The certificate of a connection that has not said who it is.
    pub(super) fn shown_by(&self, peer: PeerId) -> Option<&Bearer> {
        match self.peers.get(&peer) {
            Some(Peer::Unnamed { identity, .. }) => identity.as_ref(),
            _ => None,
        }
    }
}

/// What a greeting claims to come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Claim<'a> {
    /// The node of that name.
    Node(&'a str),
    /// A spare that calls itself so.
    Spare(&'a str),
    /// Another master.
    Master,
    /// Who has the place of this node, with what was shown for that.
    ChunksOf(&'a str, Option<&'a Bearer>),
}

/// Most names of tiles in a reason.
const MAX_NAMED: usize = 6;

impl Admission {
    /// Whether a connection with such a certificate is what it claims to be. A node that the wall lacks is nobody's, and passes.
    fn check(self, shown: Option<&Bearer>, claim: Claim<'_>, wall: &Wall) -> Result<(), Bye> {
        if self == Self::ByName {
            return Ok(());
        }
        let refused = |reason: String| Err(Bye::new(ByeCode::Refused, reason));
        let Some(shown) = shown else {
            return refused("this master takes peers with certificates only, and there is none on this connection".to_owned());
        };
        match (shown, claim) {
            (Bearer::Node(node), Claim::Node(name)) if node.name == name => check_tiles(node, wall),
            (Bearer::Spare(own), Claim::Spare(name)) if own == name => Ok(()),
            (Bearer::Master, Claim::Master) => Ok(()),
            (shown, Claim::ChunksOf(_, holder)) if holder == Some(shown) => Ok(()),
            (shown, Claim::Node(name)) => refused(format!(
                "the certificate is for {shown}, but the greeting is that of node {name:?}: give it --identity nodes/{name}.pem"
            )),
            (shown, Claim::Spare(name)) => refused(format!(
                "the certificate is for {shown}, but the greeting is that of spare {name:?}: give it --identity spares/{name}.pem"
            )),
            (shown, Claim::Master) => refused(format!(
                "the certificate is for {shown}, but the greeting is that of a master: give it a file of standbys/ as --identity"
            )),
            (shown, Claim::ChunksOf(name, _)) => {
                refused(format!("the certificate is for {shown}, who is not who has the place of node {name:?}"))
            }
        }
    }
}

/// Whether the wall gives a node the tiles that its certificate is for.
fn check_tiles(shown: &NodeIdentity, wall: &Wall) -> Result<(), Bye> {
    let name = &shown.name;
    let of_wall = wall.nodes().iter().find(|node| node.name == *name).map(|node| NodeIdentity::of(wall, node));
    match of_wall {
        Some(of_wall) if of_wall.tiles != shown.tiles => {
            let reason = format!(
                "the certificate of node {name:?} is for tiles {}, but the wall gives it {}: run `mullion enroll` again and copy \
                 nodes/{name}.pem to the node",
                list(&shown.tiles),
                list(&of_wall.tiles)
            );
            Err(Bye::new(ByeCode::Refused, reason))
        }
        _ => Ok(()),
    }
}

fn list(tiles: &[String]) -> String {
    let named = tiles.iter().take(MAX_NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    if tiles.len() > MAX_NAMED { format!("{named} and {} more", tiles.len() - MAX_NAMED) } else { named }
}
