//! `mullion prepare`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use mullion_common::scene::{LodForm, Package};
use mullion_server::prepare::lod::{LodOptions, LodStatistics, add_hierarchies};
use mullion_server::prepare::plp::{TessellateOptions, TessellationStatistics, tessellate};
use mullion_server::prepare::{MAX_LEAF_TRIANGLES, PrepareOptions, statistics, write_package};

use crate::files::open_scene;
use crate::progress::Progress;
use crate::say::say;

/// What to prepare, where to and how.
#[derive(clap::Args)]
pub struct Options {
    /// glTF or GLB file.
    scene: PathBuf,
    /// The package to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    how: HowToPrepare,
    /// Tessellate the space around the geometry, too, so that nodes can draw to a budget.
    #[arg(long)]
    plp: bool,
    /// Divide space down to this share of the scene's longest side (with --plp only) [default: 0.05].
    #[arg(long, value_name = "SHARE", requires = "plp", allow_negative_numbers = true)]
    plp_leaf: Option<f64>,
    /// Simplify large meshes, too, so that nodes can draw them as coarsely as their distance allows: a vertex at a time (vertices), or a group of
    /// clusters (clusters). Of both, shows with a budget of triangles draw vertices, others clusters.
    #[arg(long, value_name = "FORM", num_args = 0..=1, require_equals = true, default_missing_value = "vertices", value_delimiter = ',')]
    lod: Vec<LodForm>,
}

/// Choices of preparation, shared by all commands that take a scene.
#[derive(clap::Args, Clone, Copy)]
pub struct HowToPrepare {
    /// Divide larger meshes into leaves of at most so many triangles.
    #[arg(long, value_name = "TRIANGLES", default_value_t = PrepareOptions::default().max_leaf_triangles,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_LEAF_TRIANGLES)))]
    leaf_triangles: u32,
    /// Cut triangles with an edge longer than this, in metres: for floors that span the scene.
    #[arg(long, allow_negative_numbers = true, value_name = "METRES")]
    split_larger_than: Option<f64>,
}

impl HowToPrepare {
    /// As the server takes it.
    pub fn options(&self) -> Result<PrepareOptions> {
        let split = self.split_larger_than;
        ensure!(
            split.is_none_or(|m| m.is_finite() && m > 0.0),
            "--split-larger-than: {} is not above 0 m",
            split.unwrap_or_default()
        );
        Ok(PrepareOptions { max_leaf_triangles: self.leaf_triangles, split_larger_than_m: split })
    }
}

/// Runs the command.
pub fn run(options: &Options) -> Result<()> {
    let start = Instant::now();
    let mut package = open_scene(&options.scene, &options.how.options()?)?;
    if options.plp {
        let leaf_share = options.plp_leaf.unwrap_or(TessellateOptions::default().leaf_share);
        add_tessellation(&mut package, &TessellateOptions { leaf_share }).context("--plp")?;
    }
    let mut simplified = Vec::new();
    for form in LodForm::ALL.into_iter().filter(|form| options.lod.contains(form)) {
        let start = Instant::now();
        simplified.push((form, simplify(&mut package, form).context("--lod")?, start.elapsed().as_secs_f64()));
    }
    write_package(&package, &options.out)?;
    let s = statistics(&package);
    say!(
        "{}: {} leaves, {} triangles ({} unique) in {} chunks, {:.1} s",
        options.out.display(),
        s.leaves,
        s.triangles_instanced,
        s.triangles_unique,
        s.geometry_chunks,
        start.elapsed().as_secs_f64()
    );
    if let Some(t) = TessellationStatistics::of(&package) {
        say!(
            "tessellation: {} cells, {:.2} references a triangle, {:.1} MB: {:.1} % of the geometry ({:.1} % of it with every instance apart)",
            t.cells,
            t.references_per_triangle(),
            t.bytes as f64 / 1e6,
            t.share_of_geometry() * 100.0,
            t.share_of_instances() * 100.0
        );
    }
    for (form, s, seconds) in simplified {
        let (form, made_of) = match form {
            LodForm::Clusters => ("cluster", format!("{} groups of {} clusters, ", s.groups, s.clusters)),
            LodForm::Vertices => ("vertex", String::new()),
        };
        say!(
            "{form} hierarchies: {} of {} vertices, {made_of}{} to {} triangles, {:.1} bytes a vertex, {seconds:.2} s",
            s.hierarchies,
            s.vertices,
            s.base_triangles,
            s.triangles,
            s.bytes_per_vertex()
        );
    }
    Ok(())
}

/// Puts hierarchies of detail into a package.
pub fn simplify(package: &mut Package, form: LodForm) -> Result<LodStatistics> {
    let progress = Progress::new();
    let report = |stage, done, total| progress.show(stage, done, total);
    let statistics = add_hierarchies(package, &LodOptions { form, ..LodOptions::default() }, &report);
    progress.finish();
    Ok(statistics?)
}

/// Tessellates a package's space and puts that into it.
pub fn add_tessellation(package: &mut Package, options: &TessellateOptions) -> Result<()> {
    let progress = Progress::new();
    let tessellation = tessellate(package, options, &|stage, done, total| progress.show(stage, done, total));
    progress.finish();
    package.scene.tessellation = Some(Arc::new(tessellation?));
    Ok(())
}
