//! Good bytes, bent and cut at random: what decoders are tried with.

use bolero::{ValueGenerator, produce};

/// How to spoil a message or a file.
#[derive(Clone, Debug)]
pub struct Spoiled {
    seed: u8,
    /// Where, and what is written there.
    edits: Vec<(u16, u8)>,
    /// What is cut out: from where, how much.
    cut: (u16, u8),
    /// What is put in: where, and what.
    splice: (u16, Vec<u8>),
}

impl Spoiled {
    /// Any way.
    pub fn any() -> impl ValueGenerator<Output = Self> {
        let edits = produce::<Vec<(u16, u8)>>().with().len(0..6usize);
        let splice = (produce::<u16>(), produce::<Vec<u8>>().with().len(0..12usize));
        (produce::<u8>(), edits, (produce::<u16>(), 0..9u8), splice).map_gen(|(seed, edits, cut, splice)| Self {
            seed,
            edits,
            cut,
            splice,
        })
    }

    /// One of some seeds, spoiled.
    pub fn of(&self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let mut body = seeds[usize::from(self.seed) % seeds.len()].clone();
        for (at, value) in &self.edits {
            // The head of a message, where its lengths stand, as often as all of it.
            let within = if at % 2 == 0 { body.len() } else { body.len().min(48) };
            body[usize::from(*at) / 2 % within] = *value;
        }
        let from = usize::from(self.cut.0) % (body.len() + 1);
        let to = body.len().min(from + usize::from(self.cut.1));
        body.drain(from..to);
        let at = usize::from(self.splice.0) % (body.len() + 1);
        body.splice(at..at, self.splice.1.iter().copied());
        body
    }
}
