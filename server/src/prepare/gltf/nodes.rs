//! The node hierarchy: a forest, proven so before anything walks it, with transforms in f64.
use super::error::{Fault, invalid, one_line, over_cap, resolve};
use super::json::{self, Root};
use super::validate::Asset;
use super::{SourceNode, instancing};
use glam::{DAffine3, DMat4, DQuat, DVec3};

/// Deepest chain of nodes. Walks are iterative; the cap keeps products of transforms meaningful.
pub const MAX_NODE_DEPTH: usize = 4096;

/// What each leaf costs in all of preparation, in bytes: its draft (8), its bound (120), a node and half a group of the
/// hierarchy as drafted and as built, its record (40) and its source (12). A primitive makes one leaf or more wherever
/// it is drawn.
const LEAF_BYTES: usize = 512;

/// How far a matrix's last row may stray from 0, 0, 0, 1.
const AFFINE_TOLERANCE: f64 = 1e-6;
/// How far a quaternion's length may stray from 1 before a warning; it is normalised either way.
const UNIT_TOLERANCE: f64 = 1e-3;

/// The nodes in glTF order, and an order to walk them in.
pub(super) struct Forest {
    pub nodes: Vec<SourceNode>,
    /// Every node once, parents before their children.
    pub top_down: Vec<u32>,
    pub roots: Vec<u32>,
}

pub(super) fn build(asset: &Asset, warnings: &mut Vec<String>) -> Result<Forest, Fault> {
    let json = asset.json;
    let parents = parents(json)?;
    let top_down = top_down(json, &parents)?;
    let roots = roots(json, &parents)?;
    let mut nodes = Vec::with_capacity(json.nodes.len());
    let mut instances_left = instancing::MAX_INSTANCES;
    for (k, raw) in json.nodes.iter().enumerate() {
        let mesh = match raw.mesh {
            Some(mesh) => Some(resolve(&json.meshes, mesh.0, "mesh", place(json, k))?.0 as u32),
            None => None,
        };
        if let Some(skin) = raw.skin {
            resolve(&json.skins, skin.0, "skin", place(json, k))?;
        }
        if let Some(camera) = raw.camera {
            resolve(&json.cameras, camera.0, "camera", place(json, k))?;
        }
        let instances = match raw.extensions.as_ref().and_then(|e| e.instancing.as_ref()) {
            Some(instancing) if mesh.is_some() => instancing::read(asset, instancing, &place(json, k), &mut instances_left)?,
            _ => Vec::new(),
        };
        if let Some(mesh) = mesh {
            // The first leaf is part of its object, which is charged as an instance or an entry of the JSON.
            let more = json.meshes[mesh as usize].primitives.len().saturating_sub(1).saturating_mul(instances.len().max(1));
            asset.budget.take(more, LEAF_BYTES, || place(json, k))?;
        }
        nodes.push(SourceNode {
            name: raw.name.clone(),
            parent: parents[k],
            // In range: `parents` resolved every child, and a list has fewer than 2^32 entries.
            children: raw.children.iter().map(|child| child.0 as u32).collect(),
            parent_from_local: transform(raw, || place(json, k), warnings)?,
            mesh,
            instances,
        });
    }
    Ok(Forest { nodes, top_down, roots })
}

/// `world_from_node` of every node; a fault where a product leaves the range of f64.
pub(super) fn worlds(forest: &Forest) -> Result<Vec<DAffine3>, Fault> {
    let mut worlds = vec![DAffine3::IDENTITY; forest.nodes.len()];
    for &k in &forest.top_down {
        let node = &forest.nodes[k as usize];
        let parent = node.parent.map_or(DAffine3::IDENTITY, |p| worlds[p as usize]);
        let world = parent * node.parent_from_local;
        if !world.is_finite() {
            return Err(invalid(format_args!("node {k}"), "its transform in the world is not finite"));
        }
        worlds[k as usize] = world;
    }
    Ok(worlds)
}

/// `node 7 "roof"`.
pub(super) fn place(json: &Root, k: usize) -> String {
    match json.nodes.get(k).and_then(|node| node.name.as_deref()) {
        Some(name) => format!("node {k} {:?}", one_line(name.chars().take(60).collect::<String>())),
        None => format!("node {k}"),
    }
}

fn parents(json: &Root) -> Result<Vec<Option<u32>>, Fault> {
    let mut parents: Vec<Option<u32>> = vec![None; json.nodes.len()];
    for (k, node) in json.nodes.iter().enumerate() {
        for child in node.children.iter() {
            let (c, _) = resolve(&json.nodes, child.0, "node", place(json, k))?;
            if let Some(first) = parents[c].replace(k as u32) {
                let first = place(json, first as usize);
                return Err(invalid(place(json, c), format_args!("has two parents, {first} and {}", place(json, k))));
            }
        }
    }
    Ok(parents)
}

/// Breadth first from the parentless nodes; what that never reaches hangs on a cycle.
fn top_down(json: &Root, parents: &[Option<u32>]) -> Result<Vec<u32>, Fault> {
    let mut order: Vec<u32> = (0..parents.len() as u32).filter(|k| parents[*k as usize].is_none()).collect();
    let mut level = 0..order.len();
    for depth in 1.. {
        if level.is_empty() {
            break;
        }
        if depth > MAX_NODE_DEPTH {
            let reason = format!("lies deeper than {MAX_NODE_DEPTH} nodes");
            let place = place(json, order[level.start] as usize);
            return Err(over_cap(place, reason, "MAX_NODE_DEPTH", MAX_NODE_DEPTH as u64));
        }
        let next = order.len();
        for at in level {
            order.extend(json.nodes[order[at] as usize].children.iter().map(|child| child.0 as u32));
        }
        level = next..order.len();
    }
    if order.len() < parents.len() {
        let mut reached = vec![false; parents.len()];
        order.iter().for_each(|k| reached[*k as usize] = true);
        // Walking up from an unreached node must enter the cycle: mark until a mark is met again.
        let mut at = reached.iter().position(|r| !r).unwrap_or(0);
        while !reached[at] {
            reached[at] = true;
            at = parents[at].map_or(at, |parent| parent as usize);
        }
        let parent = parents[at].map_or(at, |parent| parent as usize);
        return Err(invalid(place(json, at), format_args!("is part of a cycle through its parent {}", place(json, parent))));
    }
    Ok(order)
}

fn roots(json: &Root, parents: &[Option<u32>]) -> Result<Vec<u32>, Fault> {
    let chosen = match json.scene {
        Some(scene) => Some(resolve(&json.scenes, scene.0, "scene", "scene")?),
        None => json.scenes.first().map(|scene| (0, scene)),
    };
    let Some((s, scene)) = chosen else {
        return Ok((0..parents.len() as u32).filter(|k| parents[*k as usize].is_none()).collect());
    };
    let mut listed = vec![false; parents.len()];
    let mut roots = Vec::with_capacity(scene.nodes.len());
    for node in scene.nodes.iter() {
        let (k, _) = resolve(&json.nodes, node.0, "node", format_args!("scene {s}"))?;
        if let Some(parent) = parents[k] {
            let parent = place(json, parent as usize);
            return Err(invalid(
                format_args!("scene {s}"),
                format_args!("lists {}, which has the parent {parent}", place(json, k)),
            ));
        }
        if std::mem::replace(&mut listed[k], true) {
            return Err(invalid(format_args!("scene {s}"), format_args!("lists {} twice", place(json, k))));
        }
        roots.push(k as u32);
    }
    Ok(roots)
}

fn transform(raw: &json::Node, place: impl Fn() -> String, warnings: &mut Vec<String>) -> Result<DAffine3, Fault> {
    let affine = if let Some(matrix) = &raw.matrix {
        let matrix = DMat4::from_cols_array(matrix);
        let stray = matrix.row(3) - glam::DVec4::W;
        if stray.abs().max_element() > AFFINE_TOLERANCE {
            return Err(invalid(place(), format_args!("matrix is not affine, its last row is {}", matrix.row(3))));
        }
        if raw.translation.is_some() || raw.rotation.is_some() || raw.scale.is_some() {
            warnings.push(format!("{}: has a matrix and TRS, the matrix is used", place()));
        }
        DAffine3::from_mat4(matrix)
    } else {
        let translation = raw.translation.map_or(DVec3::ZERO, DVec3::from_array);
        let scale = raw.scale.map_or(DVec3::ONE, DVec3::from_array);
        let mut rotation = raw.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
        let length = rotation.length();
        if !(length > f64::MIN_POSITIVE && length.is_finite()) {
            return Err(invalid(place(), format_args!("rotation {rotation} has no direction")));
        }
        if (length - 1.0).abs() > UNIT_TOLERANCE {
            warnings.push(format!("{}: rotation of length {length} is normalised", place()));
        }
        rotation = rotation.normalize();
        DAffine3::from_scale_rotation_translation(scale, rotation, translation)
    };
    if !affine.is_finite() {
        return Err(invalid(place(), "its transform is not finite"));
    }
    Ok(affine)
}
