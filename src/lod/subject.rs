//! What is simplified: a package's objects that have hierarchies of detail, once or in a row.

use std::sync::Arc;

use anyhow::{Context, Result};
use glam::{DAffine3, DVec3, Vec3};
use mullion_client::gpu::CutObject;
use mullion_client::lod::{Cut, LodObject, StepId, Tessellated};
use mullion_common::geometry::Aabb;
use mullion_common::scene::{AlphaMode, Hierarchy, LodForm, ObjectId, Package, Presence, Scene, Transform};
use mullion_common::visible_set::{LeafRange, VisibleSet};

use super::{Look, Seen};
use crate::item_buffer::ItemScene;

/// The objects.
pub struct Subject {
    /// With every copy among its objects and leaves.
    pub package: Package,
    hierarchies: Vec<Hierarchy>,
    parts: Vec<Part>,
    /// Of all that is simplified, in the world; of one copy.
    pub bounds: Aabb,
    /// Leaves that are not simplified.
    pub others: VisibleSet,
    /// Of those, what hides what is behind.
    backdrop: ItemScene,
}

struct Part {
    hierarchy: usize,
    object: ObjectId,
    leaf: u32,
    is_double_sided: bool,
    is_solid: bool,
}

impl Subject {
    /// Reads a package's hierarchies, of this form if it has some, and puts copies of the scene behind each other, each `step` further.
    ///
    /// # Errors
    /// When the package has none, or they cannot be read.
    pub fn new(mut package: Package, form: LodForm, (copies, step): (u32, DVec3)) -> Result<Self> {
        let table = package
            .scene
            .hierarchies
            .preferring(form)
            .cloned()
            .context("no object of the scene has triangles enough to be simplified")?;
        let decoded = |number| table.decode(number, &package.scene.manifest).context("a hierarchy");
        let hierarchies = (0..table.entries().len()).map(decoded).collect::<Result<Vec<Hierarchy>>>()?;
        if copies > 1 {
            // It knows of one.
            package.scene.tessellation = None;
        }
        let manifest = &mut package.scene.manifest;
        let (objects, leaves) = (manifest.transforms.clone(), manifest.leaves.clone());
        for copy in 1..copies {
            let moved = |t: &Transform| -> Transform {
                let affine = t.affine();
                DAffine3 { translation: affine.translation + step * f64::from(copy), ..affine }.into()
            };
            let first = manifest.transforms.len() as u32;
            manifest.transforms.extend(objects.iter().map(moved));
            manifest.leaves.extend(leaves.iter().map(|leaf| {
                let mut leaf = *leaf;
                leaf.object = ObjectId(first + leaf.object.0);
                leaf
            }));
        }
        let mut first_leaf = vec![None; manifest.transforms.len()];
        for (number, leaf) in (0..).zip(&manifest.leaves) {
            first_leaf[leaf.object.0 as usize].get_or_insert(number);
        }
        let mut parts = Vec::new();
        let own = objects.len() as u32;
        for (number, entry) in table.entries().iter().enumerate() {
            let materials = &hierarchies[number].materials();
            let materials = || materials.iter().map(|m| &manifest.materials[m.0 as usize]);
            let is_double_sided = materials().any(|material| material.double_sided);
            let is_solid = materials().all(|material| material.alpha == AlphaMode::Opaque);
            for object in (0..copies).flat_map(|copy| entry.objects.iter().map(move |o| o.0 + copy * own)) {
                let Some(leaf) = first_leaf[object as usize] else { continue };
                parts.push(Part { hierarchy: number, object: ObjectId(object), leaf, is_double_sided, is_solid });
            }
        }
        parts.sort_unstable_by_key(|part| part.object);
        let is_covered = |object: ObjectId| parts.binary_search_by_key(&object, |part| part.object).is_ok();
        let of_part = (0..).zip(&manifest.leaves).filter(|(_, leaf)| is_covered(leaf.object));
        let covered = VisibleSet::from_ranges(of_part.map(|(number, _)| LeafRange::new(number, number + 1)));
        let corners = leaves.iter().filter(|leaf| is_covered(leaf.object)).flat_map(|leaf| {
            let world_from_local = manifest.transforms[leaf.object.0 as usize].affine();
            leaf.local_aabb().corners().map(|corner| world_from_local.transform_point3(corner))
        });
        let bounds = Aabb::of_points(corners);
        let mut others = VisibleSet::default();
        VisibleSet::all(manifest.leaves.len() as u32).difference_into(&covered, &mut others);
        let manifest = &package.scene.manifest;
        let is_solid =
            |leaf: u32| manifest.materials[manifest.leaves[leaf as usize].material.0 as usize].alpha == AlphaMode::Opaque;
        let backdrop = ItemScene::of_leaves(&package, bounds.center(), others.leaves().filter(|leaf| is_solid(*leaf)));
        Ok(Self { package, hierarchies, parts, bounds, others, backdrop })
    }

    /// Where there is a tessellation: the space around all copies.
    pub fn tessellated(&self) -> Option<Tessellated<'_>> {
        let Scene { tessellation, manifest: scene, .. } = &self.package.scene;
        tessellation.as_deref().map(|tessellation| Tessellated { tessellation, scene })
    }

    /// As refinement takes them.
    pub fn objects(&self) -> Vec<LodObject<'_>> {
        let transforms = &self.package.scene.manifest.transforms;
        let object = |part: &Part| LodObject {
            id: part.object,
            hierarchy: &self.hierarchies[part.hierarchy],
            world_from_local: transforms[part.object.0 as usize].affine(),
            is_double_sided: part.is_double_sided,
            is_solid: part.is_solid,
            presence: Presence::There,
            weight: 1.0,
        };
        self.parts.iter().map(object).collect()
    }

    /// Which they are.
    pub fn ids(&self) -> Vec<ObjectId> {
        self.parts.iter().map(|part| part.object).collect()
    }

    /// As they are drawn.
    pub fn cut_objects<'a>(&'a self, cuts: &'a [Cut]) -> impl Iterator<Item = CutObject<'a>> {
        self.parts.iter().zip(cuts).map(|(part, cut)| CutObject {
            object: part.object,
            leaf: part.leaf,
            hierarchy: &self.hierarchies[part.hierarchy],
            cut,
        })
    }

    /// Triangles of all hierarchies' objects.
    pub fn triangle_count(&self) -> u64 {
        self.parts.iter().map(|part| u64::from(self.hierarchies[part.hierarchy].triangle_count())).sum()
    }

    /// What is seen of cuts, and of all that is not simplified.
    pub fn seen(&self, look: &Look, cuts: &[Cut], size_px: [u32; 2]) -> Seen {
        let simplified = self.cut_scene(look, cuts);
        let count = simplified.len() as u32;
        Seen::new(look, simplified.and(&self.backdrop), count, size_px)
    }

    /// Triangles of cuts, relative to an eye.
    fn cut_scene(&self, look: &Look, cuts: &[Cut]) -> ItemScene {
        let eye = look.projection.eye;
        let objects = self.objects();
        let triangles = objects.iter().zip(cuts).flat_map(|(object, cut)| {
            let from_local = DAffine3::from_translation(-eye) * object.world_from_local;
            let positions = &object.hierarchy.vertices().positions;
            let place = |v: u32| from_local.transform_point3(Vec3::from(positions[v as usize]).as_dvec3()).as_vec3();
            let placed: Vec<Vec3> = cut.vertices(object.hierarchy).map(place).collect();
            let is_mirrored = object.world_from_local.matrix3.determinant() < 0.0;
            cut.placed_triangles(object.hierarchy).map(move |[a, b, c]| {
                let corners = if is_mirrored { [a, c, b] } else { [a, b, c] };
                (corners.map(|v| placed[v as usize]), object.is_double_sided)
            })
        });
        ItemScene::of_triangles(eye, triangles)
    }

    /// What is seen of the whole meshes, and of all that is not simplified.
    pub fn seen_whole(&self, look: &Look, size_px: [u32; 2]) -> Seen {
        let all = |part: &Part| {
            let hierarchy = &self.hierarchies[part.hierarchy];
            let steps: Vec<StepId> = match hierarchy {
                Hierarchy::Vertices(of) => {
                    let splits = (of.base_count()..of.vertex_count()).map(StepId);
                    splits.filter(|step| !of.is_follower(step.lead())).collect()
                }
                Hierarchy::Clusters(of) => (0..of.group_count()).map(StepId).collect(),
            };
            let mut cut = Cut::new(hierarchy);
            cut.follow(hierarchy, &steps, |_| true);
            cut
        };
        let cuts: Vec<Cut> = self.parts.iter().map(all).collect();
        self.seen(look, &cuts, size_px)
    }

    /// The package for a renderer: shared.
    pub fn manifest(&self) -> Arc<mullion_common::scene::SceneManifest> {
        Arc::new(self.package.scene.manifest.clone())
    }
}
