//! Whether who greets is the node that it says it is.

use mullion_common::identity::NodeIdentity;
use mullion_common::wall::Wall;
use mullion_common::wire::{Bye, ByeCode};

use super::{Master, Peer, PeerId};

/// Whom a master believes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Admission {
    /// Everyone: a name is enough.
    #[default]
    ByName,
    /// Who has shown the certificate of that node and its tiles.
    ByCertificate,
}

impl Master {
    /// The same, but choosy.
    pub fn admitting(mut self, admission: Admission) -> Self {
        self.admission = admission;
        self
    }

    /// A connection has shown a certificate of the wall's authority, for this node.
    pub fn handle_identity(&mut self, peer: PeerId, shown: NodeIdentity) {
        if let Some(Peer::Unnamed { identity, .. }) = self.peers.get_mut(&peer) {
            *identity = Some(shown);
        }
    }

    /// Whether a connection that has not said who it is may be the node of that name.
    pub(super) fn admit(&self, peer: PeerId, name: &str) -> Result<(), Bye> {
        let identity = match self.peers.get(&peer) {
            Some(Peer::Unnamed { identity, .. }) => identity.as_ref(),
            _ => None,
        };
        self.admission.check(identity, name, &self.wall)
    }
}

/// Most names of tiles in a reason.
const MAX_NAMED: usize = 6;

impl Admission {
    /// Whether a connection with such a certificate may act as the node `name`. A name that the wall lacks is nobody's, and passes.
    fn check(self, identity: Option<&NodeIdentity>, name: &str, wall: &Wall) -> Result<(), Bye> {
        if self == Self::ByName {
            return Ok(());
        }
        let refused = |reason: String| Err(Bye::new(ByeCode::Refused, reason));
        let Some(identity) = identity else {
            return refused("this master takes nodes with certificates only, and there is none on this connection".to_owned());
        };
        if identity.name != name {
            return refused(format!(
                "the certificate is for node {:?}, but the node says that it is {name:?}: give it --identity nodes/{name}.pem",
                identity.name
            ));
        }
        let of_wall = wall.nodes().iter().find(|node| node.name == name).map(|node| NodeIdentity::of(wall, node));
        match of_wall {
            Some(of_wall) if of_wall.tiles != identity.tiles => refused(format!(
                "the certificate of node {name:?} is for tiles {}, but the wall gives it {}: run `mullion enroll` again and copy \
                 nodes/{name}.pem to the node",
                list(&identity.tiles),
                list(&of_wall.tiles)
            )),
            _ => Ok(()),
        }
    }
}

fn list(tiles: &[String]) -> String {
    let named = tiles.iter().take(MAX_NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    if tiles.len() > MAX_NAMED { format!("{named} and {} more", tiles.len() - MAX_NAMED) } else { named }
}
