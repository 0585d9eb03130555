//! Shares with their uncertainty.

use serde::Serialize;

/// How many of how many, with Wilson's 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Share {
    /// How many did.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
}

impl Share {
    /// Counts one more.
    pub fn add(&mut self, hit: bool) {
        self.hits += usize::from(hit);
        self.of += 1;
    }

    /// The share; nothing of none.
    pub fn value(&self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }

    /// Wilson's score interval at 95 %; nothing of none.
    pub fn interval(&self) -> Option<[f64; 2]> {
        const Z: f64 = 1.959_963_985;
        let share = self.value()?;
        let count = self.of as f64;
        let centre = (share + Z * Z / (2.0 * count)) / (1.0 + Z * Z / count);
        let half = Z / (1.0 + Z * Z / count) * (share * (1.0 - share) / count + Z * Z / (4.0 * count * count)).sqrt();
        Some([(centre - half).max(0.0), (centre + half).min(1.0)])
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.value(), self.interval()) {
            (Some(share), Some([low, high])) => {
                let text = format!("{:.1} % [{:.1}, {:.1}] of {}", 100.0 * share, 100.0 * low, 100.0 * high, self.of);
                f.pad(&text)
            }
            _ => f.pad("–"),
        }
    }
}

/// The value below which this share of `values` lies, between neighbours by straight lines; nothing of none.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    Some(sorted[below] + (place - below as f64) * (sorted[above] - sorted[below]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against tables: 8 of 10 gives [0.490, 0.943], 0 of 300 ends at 0.0126 (Newcombe 1998, method 3).
    #[test]
    fn wilson_intervals_are_those_of_the_tables() {
        let [low, high] = Share { hits: 8, of: 10 }.interval().expect("ten cases");
        assert!((low - 0.4902).abs() < 5e-4 && (high - 0.9433).abs() < 5e-4, "{low} {high}");
        let [low, high] = Share { hits: 0, of: 300 }.interval().expect("three hundred cases");
        assert!(low.abs() < 1e-12 && (high - 0.01264).abs() < 5e-5, "{low} {high}");
        assert_eq!(Share::default().interval(), None);
    }

    #[test]
    fn quantiles_lie_between_neighbours() {
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[0.0, 1.0], 0.95), Some(0.95));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
