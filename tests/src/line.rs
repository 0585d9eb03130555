//! One direction of a line between host and board, which can be cut or noisy for a while.

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

/// What is wrong with a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// Every byte vanishes, and neither end is told: a cable pulled out.
    Cut,
    /// So many bytes in a million suffer: half of them vanish, the others arrive with some bits flipped. Where the line
    /// ends in a serial port, the port also sees as many framing errors and as much noise.
    Noise {
        /// How many.
        per_million: u32,
    },
}

/// What became of the bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Bytes that vanished.
    pub lost: u64,
    /// Bytes that arrived as something else.
    pub damaged: u64,
}

/// One direction of a line. A seed makes the noise, so it is the same in every run.
#[derive(Debug)]
pub struct Line {
    trouble: Option<(Trouble, u64)>,
    random: Pcg64,
    losses: Losses,
}

impl Line {
    /// A sound line.
    pub fn new(seed: u64) -> Self {
        Self { trouble: None, random: Pcg64::seed_from_u64(seed), losses: Losses::default() }
    }

    /// From now on in trouble, until `until_ns`.
    pub fn disturb(&mut self, trouble: Trouble, until_ns: u64) {
        self.trouble = Some((trouble, until_ns));
    }

    /// What arrives at `at_ns`, if anything does.
    pub fn carry(&mut self, at_ns: u64, byte: u8) -> Option<u8> {
        match self.trouble.filter(|&(_, until_ns)| at_ns < until_ns) {
            None => Some(byte),
            Some((Trouble::Cut, _)) => {
                self.losses.lost += 1;
                None
            }
            Some((Trouble::Noise { per_million }, _)) => {
                let drawn = self.random.next_u64();
                // The upper half decides whether, the lower how.
                if ((drawn >> 32) * 1_000_000) >> 32 >= u64::from(per_million) {
                    return Some(byte);
                }
                if drawn & 1 == 0 {
                    self.losses.lost += 1;
                    None
                } else {
                    self.losses.damaged += 1;
                    Some(byte ^ (1 + (drawn >> 1) % 255) as u8)
                }
            }
        }
    }

    /// What became of the bytes so far.
    pub fn losses(&self) -> Losses {
        self.losses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_carries_loses_and_damages_what_it_is_told_to() {
        let mut line = Line::new(1);
        assert_eq!(line.carry(0, 7), Some(7));
        line.disturb(Trouble::Cut, 100);
        assert_eq!((line.carry(99, 7), line.carry(100, 8)), (None, Some(8)));
        line.disturb(Trouble::Noise { per_million: 100_000 }, u64::MAX);
        let arrived: Vec<u8> = (0..100_000).filter_map(|at_ns| line.carry(at_ns, 7)).collect();
        let damaged = arrived.iter().filter(|&&byte| byte != 7).count() as u64;
        let Losses { lost, damaged: counted } = line.losses();
        assert_eq!((lost - 1, damaged), (100_000 - arrived.len() as u64, counted));
        assert!((4_500..5_500).contains(&lost) && (4_500..5_500).contains(&damaged), "{lost} lost, {damaged} damaged");
    }
}
