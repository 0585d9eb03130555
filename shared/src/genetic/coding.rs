//! Genes as bits and as numbers.

/// Where a gene is searched for, both ends included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// The number meant by the lowest level.
    pub low: f64,
    /// The number meant by the highest level.
    pub high: f64,
}

/// How the bits of a gene are read as one of `2^bits` equally spaced levels of its range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coding {
    /// The level as a plain binary number, as in the paper. Neighbouring levels may differ in every bit, and at such a
    /// "Hamming cliff" the search can stop for good, however many generations follow.
    Binary,
    /// Reflected Gray code: neighbouring levels differ in exactly one bit, so one mutation can always take the last
    /// small step (Caruana and Schaffer, 1988).
    Gray,
}

impl Coding {
    /// The gene of `bits` bits (1 to 32) nearest to `value`, which is first clamped to the range.
    pub fn encode(self, value: f64, range: Range, bits: u32) -> u32 {
        let fraction = (value.max(range.low).min(range.high) - range.low) / (range.high - range.low);
        let level = (fraction * f64::from(highest_level(bits)) + 0.5) as u32;
        match self {
            Self::Binary => level,
            Self::Gray => level ^ (level >> 1),
        }
    }

    /// The number a gene of `bits` bits (1 to 32) stands for: `low + (high - low) level / (2^bits - 1)`.
    pub fn decode(self, gene: u32, range: Range, bits: u32) -> f64 {
        let level = match self {
            Self::Binary => gene,
            // Every bit of the level is the parity of the gene's bits from the top down to it.
            Self::Gray => [16, 8, 4, 2, 1].iter().fold(gene, |parity, shift| parity ^ (parity >> shift)),
        };
        let fraction = f64::from(level) / f64::from(highest_level(bits));
        // In this form both ends of the range are reached exactly, whatever the rounding.
        range.low * (1.0 - fraction) + range.high * fraction
    }
}

/// The highest level of a gene of `bits` bits (1 to 32), which is also the mask of its bits.
pub(super) fn highest_level(bits: u32) -> u32 {
    u32::MAX >> (u32::BITS - bits)
}
