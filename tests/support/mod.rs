//! What several integration tests need.
#![allow(dead_code)] // each test uses its part

use std::path::{Path, PathBuf};

use mullion_common::scene::Package;
use mullion_server::generate::{GeneratedScene, write_glb};
use mullion_server::prepare::{self, PrepareOptions};

/// The generated city, written once a test process.
pub fn city(folder: &Path) -> PathBuf {
    let path = folder.join("city.glb");
    write_glb(GeneratedScene::City, 1, &path).expect("the city can be written");
    path
}

/// A scene, prepared.
pub fn package(path: &Path, options: &PrepareOptions) -> Package {
    prepare::open(path, options, &|_, _, _| {}).unwrap_or_else(|e| panic!("{e}")).package
}

/// Third-party scenes by name, from the folder that `MULLION_MODELS` names; says so and gives none where it is unset.
pub fn models(names: &[&str]) -> Vec<PathBuf> {
    match std::env::var_os("MULLION_MODELS") {
        Some(folder) => names.iter().map(|name| Path::new(&folder).join(name)).collect(),
        None => {
            println!("skipped {names:?}: MULLION_MODELS is not set");
            Vec::new()
        }
    }
}

/// A small deterministic generator (splitmix64) for seeds in tests.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}
