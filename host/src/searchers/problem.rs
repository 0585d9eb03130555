//! One search to be made: candidates in the unit box, a budget, and objectives that may change on the way.

/// What an optimiser is given.
///
/// The budget is spent in equal parts on every stage; with more than one stage the objective changes, and an optimiser
/// has to judge what it keeps anew.
pub struct Problem<'a> {
    /// Numbers in a candidate.
    pub dimensions: usize,
    /// Candidates that may be judged.
    pub budget: usize,
    /// Stages.
    pub stages: usize,
    judge: Judge<'a>,
    judged: usize,
}

/// Gives the objectives of candidates, each in the unit box, at a stage; called with how many were judged before.
type Judge<'a> = &'a mut dyn FnMut(usize, usize, &[Vec<f64>]) -> Vec<f64>;

impl<'a> Problem<'a> {
    /// A search not begun.
    pub fn new(dimensions: usize, budget: usize, stages: usize, judge: Judge<'a>) -> Self {
        Self { dimensions, budget, stages, judge, judged: 0 }
    }

    /// The stage that the next candidate is judged at.
    pub fn stage(&self) -> usize {
        (self.judged * self.stages / self.budget).min(self.stages - 1)
    }

    /// Whether the budget is spent.
    pub fn is_over(&self) -> bool {
        self.judged >= self.budget
    }

    /// The objectives of `candidates` at the stage the search is at. Numbers outside the unit box are clamped to it.
    pub fn judge(&mut self, candidates: &[Vec<f64>]) -> Vec<f64> {
        let inside: Vec<Vec<f64>> =
            candidates.iter().map(|genes| genes.iter().map(|gene| gene.clamp(0.0, 1.0)).collect()).collect();
        let stage = self.stage();
        let objectives = (self.judge)(stage, self.judged, &inside);
        self.judged += candidates.len();
        objectives
    }
}
