//! The whole algorithm.

use proptest::prelude::*;
use rand_core::Rng;
use shared::genetic::{Coding, Error, Genetic, Range, Settings};

use crate::common::{Paper, coding, each, paper, random, rastrigin, sphere};

#[test]
fn the_default_is_what_the_paper_lists() {
    let settings = Settings::paper();
    assert_eq!(
        (settings.selective_pressure, settings.crossover_probability, settings.migration_rate, settings.generation_gap),
        (2.0, 0.6, 0.3, 0.94)
    );
    assert_eq!((settings.generations, settings.coding), (40, Coding::Binary));
}

#[test]
fn a_run_reports_the_first_population_and_every_generation() {
    let (mut genetic, mut seen, mut evaluations) = (paper::<9>(Settings::paper(), 5.0, 13), Vec::new(), 0);
    let objective = |candidates: &[[f64; 9]], objectives: &mut [f64]| {
        evaluations += candidates.len() as u64;
        each(sphere)(candidates, objectives);
    };
    genetic.run(objective, |progress| seen.push((progress.generation(), progress.evaluations())));
    // 4 x 20 individuals, then 4 x 19 offspring a generation.
    assert!(seen.into_iter().eq((0..=40).map(|generation| (generation, 80 + 76 * u64::from(generation)))));
    assert_eq!(evaluations, genetic.evaluations());
}

#[test]
fn the_best_is_the_best_of_the_subpopulations_and_scores_what_it_says() {
    let mut genetic: Paper<9> = paper(Settings::paper(), 5.0, 14);
    genetic.run(each(sphere), |genetic| {
        let (genes, objective) = genetic.best();
        assert_eq!(sphere(&genes), objective);
        let bests = [0, 1, 2, 3].map(|subpopulation| genetic.best_of(subpopulation));
        assert!(bests.contains(&(genes, objective)));
        assert!(bests.iter().all(|best| best.1 >= objective && best.1 == sphere(&best.0)));
    });
}

#[test]
fn the_seed_alone_decides() {
    let trace = |seed| {
        let (mut genetic, mut trace) = (paper::<9>(Settings::paper(), 5.12, seed), Vec::new());
        genetic.run(each(rastrigin), |genetic| trace.push(genetic.best()));
        trace
    };
    assert_eq!(trace(15), trace(15));
    assert_ne!(trace(15)[0], trace(16)[0]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_subpopulation_ever_gets_worse(
        seed: u64, coding in coding(), selective_pressure in 1.0..=2.0, crossover_probability in 0.0..=1.0,
        mutation_probability in prop::option::of(0.0..=1.0), generation_gap in 0.0..=1.0,
        migration_rate in prop_oneof![Just(0.5), 0.0..=0.5], migration_interval in 1_u32..5,
        bits_per_gene in 1_u32..=32,
    ) {
        let settings = Settings {
            bits_per_gene, coding, selective_pressure, crossover_probability, mutation_probability, generation_gap,
            migration_rate, migration_interval, generations: 15, ..Settings::default()
        };
        // Odd sizes and a plateau of NaN, where rounding and ties are most likely to go wrong.
        let ranges = [Range { low: -5.0, high: 4.0 }; 3];
        let mut genetic = Genetic::<3, 7, 3, _>::new(settings, ranges, random(seed)).unwrap();
        let mut best = [f64::INFINITY; 3];
        genetic.run(each(|genes| if genes[0] > 2.0 { f64::NAN } else { rastrigin(genes) }), |genetic| {
            for (subpopulation, best) in best.iter_mut().enumerate() {
                let (genes, objective) = genetic.best_of(subpopulation);
                assert!(objective <= *best);
                assert!(genes.iter().all(|gene| (-5.0..=4.0).contains(gene)));
                *best = objective;
            }
        });
    }
}

/// Off centre, so that no coding has the optimum at a special level.
const OFF_CENTRE: Range = Range { low: -4.0, high: 6.0 };
const SEEDS: u64 = 20;

/// The best objective at the end of runs with different seeds.
fn searches(settings: Settings, objective: fn(&[f64; 9]) -> f64) -> Vec<f64> {
    let search = |seed| {
        let mut genetic = Paper::new(settings, [OFF_CENTRE; 9], random(seed)).unwrap();
        genetic.run(each(objective), |_| ());
        genetic.best().1
    };
    (0..SEEDS).map(search).collect()
}

/// The best objectives among as many uniformly random points as the paper's algorithm evaluates.
fn random_searches(objective: fn(&[f64; 9]) -> f64) -> Vec<f64> {
    let search = |seed| {
        let mut random = random(1000 + seed);
        let mut gene =
            || OFF_CENTRE.low + (OFF_CENTRE.high - OFF_CENTRE.low) * f64::from(random.next_u32()) / 2_f64.powi(32);
        let points = (0..80 + 40 * 76).map(|_| std::array::from_fn(|_| gene()));
        points.map(|point| objective(&point)).fold(f64::INFINITY, f64::min)
    };
    (0..SEEDS).map(search).collect()
}

#[test]
fn every_search_ends_below_every_random_search_of_the_same_length() {
    for coding in [Coding::Binary, Coding::Gray] {
        for objective in [sphere, rastrigin] {
            let worst = searches(Settings { coding, ..Settings::paper() }, objective).into_iter().fold(0.0, f64::max);
            let lucky = random_searches(objective).into_iter().fold(f64::INFINITY, f64::min);
            // If both were equally good, all 20 would end below all 20 with probability 1 / C(40, 20) = 7e-12.
            assert!(worst < lucky, "{coding:?}: {worst} against {lucky}");
        }
    }
}

#[test]
fn the_papers_settings_come_near_the_bottom_of_a_nine_dimensional_sphere() {
    for coding in [Coding::Binary, Coding::Gray] {
        // The ball of objective below 5 fills pi^4.5 / gamma(5.5) 5^4.5 / 10^9 = 4.6e-6 of the range: of random
        // searches as long, one in 70 gets there.
        let finals = searches(Settings { coding, ..Settings::paper() }, sphere);
        assert!(finals.iter().all(|&objective| objective < 5.0), "{coding:?}: {finals:?}");
    }
}

#[test]
fn given_time_gray_coding_reaches_the_resolution_and_binary_coding_is_caught_at_a_hamming_cliff() {
    let run = |coding| searches(Settings { coding, generations: 400, ..Settings::paper() }, sphere);
    let gray = run(Coding::Gray).into_iter().fold(0.0, f64::max);
    let binary = run(Coding::Binary).into_iter().fold(f64::INFINITY, f64::min);
    let hundred_steps = 100.0 * (OFF_CENTRE.high - OFF_CENTRE.low) / 1_048_575.0;
    assert!(gray < 9.0 * hundred_steps.powi(2), "{gray}");
    // If both were equally good, all 20 would end below all 20 with probability 7e-12.
    assert!(gray < binary, "{gray} against {binary}");
}

#[test]
fn what_is_no_number_ranks_last_and_never_wins() {
    // Wherever it would pay most to go there is no number, or an infinite one.
    let forbidding = |&[x, y]: &[f64; 2]| match (x < 0.0, y < 0.0) {
        (true, true) => f64::INFINITY,
        (true, false) => f64::NAN,
        (false, true) => f64::NEG_INFINITY,
        (false, false) => x + y,
    };
    for seed in 0..20 {
        let mut genetic: Paper<2> = paper(Settings::paper(), 1.0, seed);
        genetic.run(each(forbidding), |genetic| {
            for subpopulation in genetic.subpopulations() {
                for (chromosome, &objective) in subpopulation.chromosomes().iter().zip(subpopulation.objectives()) {
                    let allowed = genetic.decode(chromosome).iter().all(|gene| *gene >= 0.0);
                    assert_eq!(objective.is_finite(), allowed);
                    assert!(objective > f64::NEG_INFINITY);
                }
            }
            // A quarter of all is allowed: that all 80 of the first population are not has probability 1e-10.
            assert!(genetic.best().1.is_finite());
        });
    }
}

#[test]
fn an_objective_that_writes_nothing_finds_nothing() {
    let mut genetic: Paper<2> = paper(Settings::paper(), 1.0, 17);
    genetic.run(|_: &[[f64; 2]], _: &mut [f64]| (), |genetic| assert_eq!(genetic.best().1, f64::INFINITY));
    // And whatever is found afterwards wins.
    genetic.step(each(sphere));
    assert!(genetic.best().1.is_finite());
}

#[test]
fn a_known_start_takes_part() {
    let mut genetic: Paper<2> = paper(Settings::paper(), 1.0, 18);
    genetic.seed_individual(2, 19, [0.25, 7.0]).unwrap();
    // Its distance to (0.25, 1), where the second gene is clamped to, is at most half a step of 2 / (2^20 - 1) a gene.
    let distance = |genes: &[f64; 2]| (genes[0] - 0.25).abs() + (genes[1] - 1.0).abs();
    genetic.initialise(each(distance));
    assert!(genetic.best().1 <= 1.0 / 1_048_575.0);
    assert_eq!(genetic.best_of(2), genetic.best());
    assert_eq!(genetic.evaluations(), 80);
    // Put in later, it makes the next step evaluate everyone once more.
    genetic.seed_individual(0, 0, [0.25, 1.0]).unwrap();
    genetic.step(each(distance));
    assert_eq!(genetic.evaluations(), 80 + 80 + 76);
    assert_eq!(genetic.best_of(0).1, genetic.best().1);
}

#[test]
fn a_known_start_must_be_numbers() {
    let mut genetic: Paper<2> = paper(Settings::paper(), 1.0, 19);
    let error = genetic.seed_individual(0, 0, [0.0, f64::NAN]).unwrap_err();
    assert!(matches!(error, Error::Seed { gene: 1, value } if value.is_nan()));
    let message = error.to_string();
    assert!(message.contains("gene 1") && message.contains("NaN") && message.contains("finite"), "{message}");
}

#[test]
fn a_changed_objective_takes_effect_on_initialising_again() {
    let mut genetic: Paper<2> = paper(Settings::paper(), 1.0, 20);
    genetic.run(each(sphere), |_| ());
    let shifted = |genes: &[f64; 2]| 10.0 + (genes[0] - 1.0).abs();
    genetic.initialise(each(shifted));
    assert_eq!(genetic.generation(), 40);
    for subpopulation in genetic.subpopulations() {
        for (chromosome, &objective) in subpopulation.chromosomes().iter().zip(subpopulation.objectives()) {
            assert_eq!(objective, shifted(&genetic.decode(chromosome)));
        }
    }
}

#[test]
fn settings_outside_their_limits_are_refused_by_name_value_and_limit() {
    type Change = fn(&mut Settings, f64);
    let limits: [(&str, Change, [f64; 2], [f64; 2]); 8] = [
        ("bits_per_gene", |s, x| s.bits_per_gene = x as u32, [1.0, 32.0], [0.0, 33.0]),
        ("selective_pressure", |s, x| s.selective_pressure = x, [1.0, 2.0], [0.99, 2.01]),
        ("crossover_probability", |s, x| s.crossover_probability = x, [0.0, 1.0], [-0.01, 1.01]),
        ("expected_mutations", |s, x| s.expected_mutations = x, [0.0, 1000.0], [-0.01, f64::INFINITY]),
        ("mutation_probability", |s, x| s.mutation_probability = Some(x), [0.0, 1.0], [-0.01, f64::NAN]),
        ("generation_gap", |s, x| s.generation_gap = x, [0.0, 1.0], [-0.01, 1.01]),
        ("migration_rate", |s, x| s.migration_rate = x, [0.0, 0.5], [f64::NAN, 0.51]),
        ("migration_interval", |s, x| s.migration_interval = x as u32, [1.0, 4_294_967_295.0], [0.0, 0.0]),
    ];
    for (name, change, allowed, refused) in limits {
        let with = |value| {
            let mut settings = Settings::paper();
            change(&mut settings, value);
            Paper::<2>::new(settings, [Range { low: 0.0, high: 1.0 }; 2], random(21)).map(|_| ())
        };
        for value in allowed {
            assert_eq!(with(value), Ok(()), "{name} = {value}");
        }
        for bad in refused {
            let error = with(bad).expect_err(name);
            assert!(matches!(error, Error::Setting { setting, value, low, high }
                if setting == name && (value == bad || bad.is_nan()) && [low, high] == allowed));
            let message = error.to_string();
            assert!(message.contains(&format!("{name} = {bad} is not within {} to {}", allowed[0], allowed[1])));
            assert!(message.contains("choose"), "no remedy: {message}");
        }
    }
}

#[test]
fn ranges_without_a_finite_width_are_refused() {
    let good = Range { low: -1.0, high: 1.0 };
    for (low, high) in
        [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::NAN), (0.0, f64::INFINITY), (-f64::MAX, f64::MAX)]
    {
        let error = Paper::<2>::new(Settings::paper(), [good, Range { low, high }], random(22)).unwrap_err();
        assert!(matches!(error, Error::Range { gene: 1, .. }));
        let message = error.to_string();
        assert!(message.contains(&format!("gene 1 has the search range {low} to {high}")), "{message}");
    }
}

#[test]
fn the_papers_size_fits_the_board() {
    // The STM32F429 has 64 KB of core-coupled and 192 KB of other memory.
    assert!(size_of::<Paper<9>>() < 14 * 1024);
}
