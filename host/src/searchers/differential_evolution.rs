//! Differential evolution, DE/rand/1/bin (Storn and Price, 1997), with their settings.

use rand_core::Rng;

use super::problem::Problem;
use super::random::{below, uniform};

/// Individuals per dimension.
const INDIVIDUALS_PER_DIMENSION: usize = 10;
/// Weight of the difference vector.
const WEIGHT: f64 = 0.5;
/// Probability that a number comes from the mutant.
const CROSSOVER: f64 = 0.9;

/// Spends the budget.
pub fn run(problem: &mut Problem, random: &mut impl Rng) {
    let dimensions = problem.dimensions;
    let count = INDIVIDUALS_PER_DIMENSION * dimensions;
    let mut population: Vec<Vec<f64>> =
        (0..count).map(|_| (0..dimensions).map(|_| uniform(random)).collect()).collect();
    let mut stage = problem.stage();
    let mut objectives = problem.judge(&population);
    while !problem.is_over() {
        if problem.stage() != stage {
            stage = problem.stage();
            objectives = problem.judge(&population);
            continue;
        }
        let trials: Vec<Vec<f64>> = (0..count).map(|target| trial(&population, target, random)).collect();
        for (index, objective) in problem.judge(&trials).into_iter().enumerate() {
            if objective <= objectives[index] {
                population[index].clone_from(&trials[index]);
                objectives[index] = objective;
            }
        }
    }
}

fn trial(population: &[Vec<f64>], target: usize, random: &mut impl Rng) -> Vec<f64> {
    let mut chosen = [target; 3];
    for place in 0..3 {
        while chosen[place] == target || chosen[..place].contains(&chosen[place]) {
            chosen[place] = below(population.len(), random);
        }
    }
    let [base, plus, minus] = chosen.map(|index| &population[index]);
    let certain = below(base.len(), random);
    (0..base.len())
        .map(|gene| {
            if gene != certain && uniform(random) >= CROSSOVER {
                return population[target][gene];
            }
            let mutant = base[gene] + WEIGHT * (plus[gene] - minus[gene]);
            // Outside the box: a random place between the base and the bound it crossed.
            if mutant < 0.0 {
                base[gene] * uniform(random)
            } else if mutant > 1.0 {
                base[gene] + (1.0 - base[gene]) * uniform(random)
            } else {
                mutant
            }
        })
        .collect()
}
