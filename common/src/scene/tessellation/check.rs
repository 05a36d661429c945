//! What makes parts a tessellation.

use super::{
    Cell, CellId, FACES, LeafRun, MAX_CELLS, MAX_COVERED_TRIANGLES, NumberRows, Tessellation, TessellationError,
    TessellationParts,
};
use crate::scene::{ChunkId, SceneManifest};

impl Tessellation {
    /// Joins parts, checked against the scene that they are of or one that grew from it: every number names what is there, neighbours share
    /// their face and name each other, runs and triangles ascend.
    ///
    /// # Errors
    /// When something does not hold.
    pub fn new(parts: TessellationParts, scene: &SceneManifest) -> Result<Self, TessellationError> {
        let TessellationParts { origin, vertices, cells, runs, words, leaves, exposures, facings } = parts;
        if !origin.is_finite() || !vertices.iter().all(|v| v.is_finite()) {
            return Err(TessellationError::NotFinite);
        }
        if cells.len() > MAX_CELLS as usize {
            return Err(TessellationError::Header { what: "cell count", value: cells.len() as u32, allowed: "0 to 16777216" });
        }
        let first_slots = first_slots(&leaves, scene)?;
        let first_facings = first_facings(&leaves, scene, facings.len())?;
        let slots = first_slots.last().copied().unwrap_or(0);
        if exposures.len() != slots as usize {
            return Err(TessellationError::Count { what: "exposures", found: exposures.len(), expected: slots.into() });
        }
        let counts = || cells.iter().map(|cell| cell.triangle_count).filter(|count| *count > 0);
        // At most 2²⁴ numbers of 32 bits, and their mean is no more than the largest.
        let all: u64 = counts().map(u64::from).sum();
        let tessellation = Self {
            origin,
            rho_mean: all.div_ceil(counts().count().max(1) as u64).max(1) as u32,
            vertices,
            cells,
            runs,
            words,
            leaves,
            exposures,
            facings,
            first_slots,
            first_facings,
        };
        tessellation.check_cells()?;
        Ok(tessellation)
    }

    /// Runs of each cell lie one behind the other, and so do the words of each run; leaves and triangles ascend.
    fn check_cells(&self) -> Result<(), TessellationError> {
        let (mut run, mut word) = (0, 0);
        for (i, cell) in self.cells.iter().enumerate() {
            let cell_error = |problem| Err(TessellationError::Cell { cell: i as u32, problem });
            let run_end = cell.run_end as usize;
            if run_end < run || run_end > self.runs.len() {
                return cell_error("its runs are not there");
            }
            if !self.runs[run..run_end].is_sorted_by(|a, b| a.place < b.place) {
                return cell_error("its leaves do not ascend");
            }
            let mut count = 0u64;
            while run < run_end {
                count += u64::from(self.check_run(run as u32, &mut word)?);
                run += 1;
            }
            if u64::from(cell.triangle_count) != count {
                return cell_error("its runs do not hold as many triangles as it says");
            }
            if cell.corners.iter().any(|corner| *corner as usize >= self.vertices.len()) {
                return cell_error("a corner is not there");
            }
            if !self.is_upright(cell) {
                return cell_error("it is flat or inside out");
            }
            if !(0..4).all(|face| self.is_mutual(CellId(i as u32), face)) {
                return cell_error("a neighbour is not there, has another face or does not name it");
            }
        }
        if run < self.runs.len() || word < self.words.len() {
            return Err(TessellationError::Run {
                run: run as u32,
                problem: "it is in no cell, or words are left that are in no run",
            });
        }
        Ok(())
    }

    /// How many triangles a run has, whose words begin at `word`; moves that on.
    fn check_run(&self, run: u32, word: &mut usize) -> Result<u32, TessellationError> {
        let run_error = |problem| Err(TessellationError::Run { run, problem });
        let LeafRun { place, end } = self.runs[run as usize];
        if place as usize >= self.leaves.len() {
            return run_error("its leaf is not covered");
        }
        let end = end as usize;
        if end <= *word || end > self.words.len() {
            return run_error("it is empty or ends beyond the words");
        }
        let numbers = NumberRows(&self.words[*word..end]);
        *word = end;
        match numbers.checked_count(self.slots(place).len() as u32) {
            Some(count) => Ok(count),
            None => run_error("its triangles do not ascend or are not in the leaf"),
        }
    }

    fn is_upright(&self, cell: &Cell) -> bool {
        let [a, b, c, d] = cell.corners.map(|corner| self.vertices[corner as usize].as_dvec3());
        (b - a).dot((c - a).cross(d - a)) > 0.0
    }

    /// Whether the cell beyond a face has it as a face, too, and names this cell there.
    fn is_mutual(&self, id: CellId, face: usize) -> bool {
        let cell = self.cell(id);
        let Some(beyond) = cell.neighbours[face].get() else { return true };
        let Some(other) = self.cells.get(beyond.index()) else { return false };
        let sorted = |cell: &Cell, face: usize| {
            let mut corners = FACES[face].map(|k| cell.corners[k]);
            corners.sort_unstable();
            corners
        };
        (0..4).any(|k| other.neighbours[k] == id && sorted(other, k) == sorted(cell, face))
    }
}

/// First slots of the covered leaves, and the number of all slots.
fn first_slots(leaves: &[u32], scene: &SceneManifest) -> Result<Vec<u32>, TessellationError> {
    let mut first_slots = Vec::with_capacity(leaves.len() + 1);
    let mut slots = 0u32;
    first_slots.push(0);
    for (place, &leaf) in leaves.iter().enumerate() {
        let leaf_error = |problem| Err(TessellationError::Leaf { leaf, problem });
        if place > 0 && leaves[place - 1] >= leaf {
            return leaf_error("leaves do not ascend");
        }
        let Some(record) = scene.leaves.get(leaf as usize) else { return leaf_error("it is not in the scene") };
        if record.triangle_count > MAX_COVERED_TRIANGLES {
            return leaf_error("it has more triangles than a tessellation covers");
        }
        let Some(end) = slots.checked_add(record.triangle_count) else {
            return leaf_error("there are too many triangles before it");
        };
        slots = end;
        first_slots.push(slots);
    }
    Ok(first_slots)
}

/// The chunks of the covered leaves, each once, ascending, with the numbers of their triangles.
pub(super) fn covered_chunks(leaves: &[u32], scene: &SceneManifest) -> Result<Vec<(ChunkId, u32)>, TessellationError> {
    let mut chunks: Vec<(ChunkId, u32)> = leaves
        .iter()
        .map(|leaf| {
            let record = &scene.leaves[*leaf as usize];
            (record.chunk, record.triangle_count)
        })
        .collect();
    chunks.sort_unstable();
    chunks.dedup();
    match chunks.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        Some(pair) => {
            let leaf = leaves.iter().find(|leaf| scene.leaves[**leaf as usize].chunk == pair[0].0).copied().unwrap_or_default();
            Err(TessellationError::Leaf { leaf, problem: "leaves of its chunk differ in how many triangles it has" })
        }
        None => Ok(chunks),
    }
}

/// For each covered leaf where the facings of its chunk start, given how many there are.
fn first_facings(leaves: &[u32], scene: &SceneManifest, facings: usize) -> Result<Vec<u32>, TessellationError> {
    let chunks = covered_chunks(leaves, scene)?;
    let mut starts = Vec::with_capacity(chunks.len());
    let mut end = 0u64;
    for (_, triangles) in &chunks {
        starts.push(end as u32); // no more than slots, which 32 bits count
        end += u64::from(*triangles);
    }
    if facings as u64 != end {
        return Err(TessellationError::Count { what: "facings", found: facings, expected: end });
    }
    let of = |leaf: &u32| {
        let at = chunks.partition_point(|(chunk, _)| *chunk < scene.leaves[*leaf as usize].chunk);
        starts[at]
    };
    Ok(leaves.iter().map(of).collect())
}
