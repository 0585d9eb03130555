//! Searchers beside the paper's genetic algorithm, all on the same kind of [`Problem`]: numbers in the unit box, a budget of
//! candidates, many judged at a time. `armid bench ga` compares them; `identify` uses the one that wins.

pub mod differential_evolution;
pub mod evolution_strategy;
mod problem;
pub mod random;

pub use problem::Problem;
