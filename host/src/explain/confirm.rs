//! The effects that the screen puts first, refitted.

use super::decide::{Case, Rival};
use super::engine::{Fitted, Free};
use super::held_out::best_of_moved;
use super::hypothesis::Hypothesis;
use super::instance::Instance;
use super::instants::instants;

/// Iterations of an effect alone, and of everything with it.
const ALONE: usize = 3;
const TOGETHER: usize = 4;
/// Iterations more, at most, of what is refitted to its end.
const TO_THE_END: usize = 10;
/// Iterations after which it shows which of several starts is the nearest.
const TO_COMPARE: usize = 3;
/// How often the edges of contacts are moved, durations that are tried then over the one before, and by how much χ² has to fall.
const MOVES: usize = 8;
const LONGER: [f64; 7] = [0.5, 0.7, 0.85, 1.0, 1.2, 1.45, 2.0];
const BETTER: f64 = 1.0;
/// A gap narrower than this many counts of the encoder shows nowhere: what it brings, its motor's inertia does.
const LEAST_PLAY_COUNTS: f64 = 0.1;

impl Case<'_> {
    /// Refits the shortlisted effects beside `current` from each of the bases, best first, and so many `leaders` to the end.
    pub fn confirm(
        &self,
        current: &Fitted,
        starts: &[Instance],
        bases: &[Vec<f64>],
        weights: &[f64],
        leaders: usize,
    ) -> Vec<(Rival, Fitted)> {
        let train = &self.train;
        let rival = |fitted: &Fitted| -> Option<Rival> {
            let instance = fitted.hypothesis.named.last().cloned()?;
            let last = fitted.hypothesis.named.len() - 1;
            let delta_bic = current.cost - fitted.cost - train.price(fitted, last, weights);
            let shows = instance.can_be() && self.is_wide_enough(&instance);
            shows.then_some(Rival { instance, delta_bic, held_out_gap: f64::NAN })
        };
        let mut confirmed: Vec<(Rival, Fitted)> = Vec::new();
        for (start, base) in starts.iter().flat_map(|start| bases.iter().map(move |base| (start, base))) {
            let hypothesis = Hypothesis { base: base.clone(), ..current.hypothesis.with(start.clone()) };
            let Some(alone) = train.refit(&hypothesis, weights, &current.columns, Free::Last, ALONE) else { continue };
            let Some(fitted) = train.refit(&alone.hypothesis, weights, &current.columns, Free::All, TOGETHER) else {
                continue;
            };
            let Some(rival) = rival(&fitted) else { continue };
            let key = |rival: &Rival| (rival.instance.kind.name, rival.instance.joint);
            match confirmed.iter_mut().find(|(other, _)| key(other) == key(&rival)) {
                Some(other) if other.0.delta_bic < rival.delta_bic => *other = (rival, fitted),
                Some(_) => {}
                None => confirmed.push((rival, fitted)),
            }
        }
        let best_first = |a: &(Rival, Fitted), b: &(Rival, Fitted)| b.0.delta_bic.total_cmp(&a.0.delta_bic);
        confirmed.sort_by(best_first);
        // What happens at instants of its own imitates much, and takes no other's place.
        let mut before = 0;
        for (leader, begun) in &mut confirmed {
            if before == leaders {
                break;
            }
            before += usize::from(!leader.instance.has_instants());
            if let Some(ended) = self.to_the_end(begun, weights)
                && let Some(better) = rival(&ended)
                && better.delta_bic > leader.delta_bic
            {
                (*leader, *begun) = (better, ended);
            }
        }
        confirmed.sort_by(best_first);
        for (rival, fitted) in &mut confirmed {
            rival.held_out_gap = self.judging_gap(&fitted.hypothesis);
        }
        confirmed
    }

    /// A model whose refit was only begun, refitted to its end: from where it is, from the baseline with the same effects, and
    /// with instants found anew. While another effect was missing, base parameters bent and instants were found where that
    /// one showed.
    fn to_the_end(&self, begun: &Fitted, weights: &[f64]) -> Option<Fitted> {
        let train = &self.train;
        // The derivatives of the model before may be far from these by now.
        let refit =
            |hypothesis: &Hypothesis, iterations: usize| train.refit(hypothesis, weights, &[], Free::All, iterations);
        let ended = |hypothesis: &Hypothesis| refit(hypothesis, TO_THE_END);
        let unbent = Hypothesis { base: train.baseline.values.of(&train.baseline.free), ..begun.hypothesis.clone() };
        let nearest = |a: &Fitted, b: &Fitted| a.cost.total_cmp(&b.cost);
        let fitted = [&begun.hypothesis, &unbent].into_iter().filter_map(ended).min_by(nearest)?;
        let anew = self.with_instants_anew(&fitted, weights);
        let anew = anew.iter().filter_map(|other| refit(other, TO_COMPARE)).min_by(nearest);
        let anew = anew.and_then(|begun| ended(&begun.hypothesis));
        let mut fitted = anew.into_iter().chain([fitted]).min_by(nearest)?;
        for _ in 0..MOVES {
            match self.with_contacts_moved(&fitted, weights).and_then(|moved| ended(&moved)) {
                Some(moved) if moved.cost < fitted.cost - BETTER => fitted = moved,
                _ => break,
            }
        }
        Some(fitted)
    }

    /// A fitted hypothesis with the edges of its contacts where the motion itself leaves least; none where it has none. A joint
    /// that a contact holds or turns round has another friction, and no derivative leads past that.
    fn with_contacts_moved(&self, fitted: &Fitted, weights: &[f64]) -> Option<Hypothesis> {
        let mut moved = None;
        for (index, instance) in fitted.hypothesis.named.iter().enumerate() {
            let Some(duration_s) = instance.common.get(1).copied().flatten().filter(|_| instance.has_instants()) else {
                continue;
            };
            let mut others = moved.as_ref().unwrap_or(&fitted.hypothesis).clone();
            others.named.remove(index);
            let each = LONGER.iter().filter_map(|factor| {
                let mut other = instance.clone();
                other.common[1] = Some(factor * duration_s);
                best_of_moved(&self.train, &others, &other, weights)
            });
            let (_, best) = each.min_by(|a, b| a.0.total_cmp(&b.0))?;
            others.named.insert(index, best);
            moved = Some(others);
        }
        moved
    }

    /// A fitted hypothesis with instants, and how long what happens at them lasts, found anew beside everything else in it;
    /// nothing where there are none.
    fn with_instants_anew(&self, fitted: &Fitted, weights: &[f64]) -> Vec<Hypothesis> {
        let train = &self.train;
        let named = &fitted.hypothesis.named;
        let mut found = Vec::new();
        for (index, instance) in named.iter().enumerate().filter(|(_, instance)| instance.has_instants()) {
            let mut without = fitted.hypothesis.clone();
            without.named.remove(index);
            let Some(left) = train.refit(&without, weights, &[], Free::All, 0) else { continue };
            let innovations = train.innovations(&without);
            let stage = train.stage(&left, &innovations);
            for other in instants(&stage, instance.kind, instance.joint, weights, None) {
                let mut hypothesis = fitted.hypothesis.clone();
                hypothesis.named[index] = other;
                found.push(hypothesis);
            }
        }
        found
    }

    /// Whether a gap between teeth is one that the encoder can show.
    fn is_wide_enough(&self, instance: &Instance) -> bool {
        let robot = self.train.setting.experiment.robot;
        let counts = |gap_rad: f64| gap_rad * robot.joints[instance.joint].counts_per_rad().abs();
        instance.kind.name != "backlash" || instance.common[0].is_none_or(|gap| counts(gap) >= LEAST_PLAY_COUNTS)
    }
}
