//! What a master wants done, peer by peer.
#![allow(dead_code)] // each test uses its part

use mullion_common::wire::{ByeCode, ToTile, body_of};
use mullion_server::master::{Output, PeerId};

/// The bodies of what was sent to a peer.
pub fn bodies(outputs: &[Output], to: PeerId) -> Vec<&[u8]> {
    let bodies = outputs.iter().filter_map(|o| match o {
        Output::Send { peer, message } if *peer == to => Some(body_of(&message.bytes)),
        _ => None,
    });
    bodies.collect()
}

/// What was sent to a node.
pub fn sent(outputs: &[Output], to: PeerId) -> Vec<ToTile> {
    bodies(outputs, to).into_iter().map(|body| ToTile::decode(body).expect("a message for nodes")).collect()
}

/// With which code a peer's connection was closed.
pub fn closed(outputs: &[Output], which: PeerId) -> Option<ByeCode> {
    outputs.iter().find_map(|o| match o {
        Output::Close { peer, bye } if *peer == which => Some(bye.code),
        _ => None,
    })
}
