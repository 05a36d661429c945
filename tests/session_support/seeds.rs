//! Which seeds simulations play, and on which walls.

/// The seeds of a simulation: `MULLION_SIM_SEED` alone, or so many as `MULLION_SIM_SEEDS` says; 100 where neither is set.
pub fn seeds() -> Vec<u64> {
    let number = |name: &str| std::env::var(name).ok().and_then(|v| v.parse::<u64>().ok());
    match number("MULLION_SIM_SEED") {
        Some(seed) => vec![seed],
        None => (0..number("MULLION_SIM_SEEDS").unwrap_or(100)).collect(),
    }
}

/// Columns and rows of a wall of 8 to 16 nodes.
pub fn small_wall(seed: u64) -> [u32; 2] {
    [[4, 2], [3, 3], [5, 2], [4, 3], [7, 2], [5, 3], [4, 4]][(seed % 7) as usize]
}
