//! Crossover, mutation, and what becomes of the offspring: reinsertion and migration.

use std::collections::HashSet;

use proptest::prelude::*;
use rand_core::{Infallible, TryRng};
use shared::genetic::{
    Settings, Subpopulation, migrate, mutate, single_point_crossover, stochastic_universal_sampling,
};

use crate::common::{
    INDIVIDUALS, Paper, SUBPOPULATIONS, assert_binomial, assert_uniform, bits, chromosome, each, paper, random, sphere,
};

proptest! {
    #[test]
    fn children_are_the_parents_up_to_a_point_and_each_other_behind_it(bits_per_gene in 1_u32..=32, seed: u64) {
        let mut random = random(seed);
        let parents: [[u32; 3]; 2] = [chromosome(bits_per_gene, &mut random), chromosome(bits_per_gene, &mut random)];
        let [mut first, mut second] = parents;
        single_point_crossover(&mut first, &mut second, bits_per_gene, 1.0, &mut random);
        // What the pair holds at each bit position is conserved.
        for gene in 0..3 {
            prop_assert_eq!(first[gene] ^ second[gene], parents[0][gene] ^ parents[1][gene]);
            prop_assert_eq!(first[gene] & second[gene], parents[0][gene] & parents[1][gene]);
        }
        let [head, tail, child] = [parents[0], parents[1], first].map(|chromosome| bits(&chromosome, bits_per_gene));
        prop_assert!((1..head.len()).any(|point| child == [&head[..point], &tail[point..]].concat()));
    }

    #[test]
    fn certain_mutation_is_the_complement_and_impossible_mutation_nothing(bits_per_gene in 1_u32..=32, seed: u64) {
        let mut random = random(seed);
        let original: [u32; 3] = chromosome(bits_per_gene, &mut random);
        let mut mutated = original;
        mutate(&mut mutated, bits_per_gene, 0.0, &mut random);
        prop_assert_eq!(mutated, original);
        mutate(&mut mutated, bits_per_gene, 1.0, &mut random);
        let all_ones = (2_u64.pow(bits_per_gene) - 1) as u32;
        prop_assert_eq!(mutated, original.map(|gene| all_ones - gene));
    }
}

/// A source of one and the same number, for what random numbers reach once in 2^32 draws.
struct Always(u32);

impl TryRng for Always {
    type Error = Infallible;
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok(self.0)
    }
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        unimplemented!()
    }
    fn try_fill_bytes(&mut self, _: &mut [u8]) -> Result<(), Infallible> {
        unimplemented!()
    }
}

#[test]
fn the_extreme_random_numbers_keep_the_promises() {
    for mut extreme in [Always(0), Always(u32::MAX)] {
        let (mut first, mut second) = ([0, 0], [31, 31]);
        single_point_crossover(&mut first, &mut second, 5, 0.0, &mut extreme);
        mutate(&mut first, 5, 0.0, &mut extreme);
        assert_eq!((first, second), ([0, 0], [31, 31]));
        mutate(&mut first, 5, 1.0, &mut extreme);
        assert_eq!(first, [31, 31]);
        single_point_crossover(&mut first, &mut [0, 0], 5, 1.0, &mut extreme);
        assert!(first == [16, 0] || first == [31, 30], "the place is not within the string: {first:?}");

        let mut selected = [9; 4];
        stochastic_universal_sampling(&[1.0, 1.0, 1.0, 1.0, 0.0], &mut selected, &mut extreme);
        assert_eq!(selected, [0, 1, 2, 3]);
    }
}

#[test]
fn a_chromosome_of_one_bit_cannot_be_crossed() {
    let (mut first, mut second) = ([0], [1]);
    single_point_crossover(&mut first, &mut second, 1, 1.0, &mut random(3));
    assert_eq!((first, second), ([0], [1]));
}

#[test]
fn pairs_are_crossed_at_the_given_rate_and_at_every_place_alike() {
    const BITS_PER_GENE: u32 = 7;
    const LENGTH: usize = 9 * BITS_PER_GENE as usize;
    for (probability, trials) in [(0.6, 20_000), (1.0, 20_000), (0.0, 100)] {
        let (mut random, mut points) = (random(4), [0; LENGTH]);
        for _ in 0..trials {
            let (mut zeros, mut ones) = ([0; 9], [127; 9]);
            single_point_crossover(&mut zeros, &mut ones, BITS_PER_GENE, probability, &mut random);
            let received: u32 = zeros.iter().map(|gene| gene.count_ones()).sum();
            points[(LENGTH - received as usize) % LENGTH] += 1;
        }
        let [uncrossed, crossed @ ..] = &points;
        assert_binomial(*uncrossed, trials, 1.0 - probability);
        if probability > 0.0 {
            assert_uniform(crossed);
        }
    }
}

#[test]
fn bits_flip_at_the_given_rate_and_everywhere_alike() {
    const BITS_PER_GENE: u32 = 20;
    for probability in [0.7 / 180.0, 0.1, 0.9] {
        let (trials, mut flips, mut random) = (20_000, vec![0; 180], random(5));
        for _ in 0..trials {
            let mut chromosome = [0; 9];
            mutate(&mut chromosome, BITS_PER_GENE, probability, &mut random);
            for (flips, bit) in flips.iter_mut().zip(bits(&chromosome, BITS_PER_GENE)) {
                *flips += bit as usize;
            }
        }
        assert_binomial(flips.iter().sum(), 180 * trials, probability);
        assert_uniform(&flips);
    }
}

#[test]
fn without_a_choice_mutation_has_the_rate_of_the_toolbox() {
    let settings = Settings { crossover_probability: 0.0, migration_rate: 0.0, ..Settings::paper() };
    let (mut unchanged, mut total) = (0, 0);
    for seed in 0..100 {
        let mut genetic: Paper<9> = paper(settings, 1.0, seed);
        let parents: Vec<_> = genetic.subpopulations().iter().flat_map(|s| *s.chromosomes()).collect();
        let parents: Vec<_> = parents.iter().map(|chromosome| genetic.decode(chromosome)).collect();
        genetic.initialise(each(sphere));
        genetic.step(|offspring: &[[f64; 9]], _: &mut [f64]| {
            total += offspring.len();
            unchanged += offspring.iter().filter(|child| parents.contains(child)).count();
        });
    }
    // Not one of 180 bits flips with probability (1 - 0.7/180)^180 = 0.4959; with the other common rate, 1/180, 0.3669.
    assert_binomial(unchanged, total, (1.0 - 0.7 / 180.0_f64).powi(180));
}

#[test]
fn mates_are_drawn_at_random() {
    let settings = Settings { crossover_probability: 1.0, mutation_probability: Some(0.0), ..Settings::paper() };
    let (mut fruitless, mut pairs) = (0, 0);
    for seed in 0..100 {
        let mut genetic: Paper<9> = paper(settings, 1.0, seed);
        genetic.initialise(each(sphere));
        let parents: Vec<_> = genetic.subpopulations().iter().flat_map(|s| *s.chromosomes()).collect();
        let parents: Vec<_> = parents.iter().map(|chromosome| genetic.decode(chromosome)).collect();
        genetic.step(|offspring: &[[f64; 9]], _: &mut [f64]| {
            for pair in offspring.chunks(19).flat_map(|siblings| siblings[..18].chunks(2)) {
                pairs += 1;
                fruitless += usize::from(pair.iter().all(|child| parents.contains(child)));
            }
        });
    }
    // The expected copies of the parents are 1.9, 1.8 ... 0.1, 0, so nine of them have a second copy with probabilities
    // 0.9, 0.8 ... 0.1. Of the 19 * 18 / 2 pairs that are possible in each subpopulation 4.5 are then a parent with
    // itself. Other mates beget themselves if they agree in front of the point or behind it: 1/2 + 1/4 + ... = 1 of the
    // 179 points for either. Unshuffled, half of the double parents would meet themselves: 0.25.
    let alone = 4.5 / 171.0;
    assert_binomial(fruitless, pairs, alone + (1.0 - alone) * 2.0 / 179.0);
}

fn any_objective() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -9.0..9.0, 2 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(f64::NEG_INFINITY)]
}

proptest! {
    #[test]
    fn offspring_replace_the_worst_parents_and_the_best_survive(
        parents in prop::collection::vec(any_objective(), 20),
        offspring in prop::collection::vec(any_objective(), 0..=20),
    ) {
        let named = |objectives: &[f64], from: u32| -> Vec<[u32; 1]> {
            (0..objectives.len() as u32).map(|index| [from + index]).collect()
        };
        let mut subpopulation = Subpopulation::<1, 20>::random(32, &mut random(6));
        subpopulation.reinsert(&named(&parents, 0), &parents);
        subpopulation.reinsert(&named(&offspring, 100), &offspring);

        // What is no finite number counts as infinite; Rust's own stable sort is the judge of the order.
        let mut expected: Vec<(f64, [u32; 1])> = parents.iter().copied().zip(named(&parents, 0)).collect();
        let order = |list: &mut Vec<(f64, [u32; 1])>| {
            list.iter_mut().filter(|(objective, _)| !objective.is_finite()).for_each(|(o, _)| *o = f64::INFINITY);
            list.sort_by(|a, b| a.0.total_cmp(&b.0));
        };
        order(&mut expected);
        expected.truncate(20 - offspring.len());
        expected.extend(offspring.iter().copied().zip(named(&offspring, 100)));
        order(&mut expected);

        let found: Vec<(f64, [u32; 1])> =
            subpopulation.objectives().iter().copied().zip(*subpopulation.chromosomes()).collect();
        prop_assert_eq!(found, expected);
    }
}

#[test]
fn the_generation_gap_decides_how_many_survive_each_generation() {
    // Offspring of each subpopulation of 20, rounded by hand; the extremes leave one parent and breed one child.
    for (generation_gap, offspring) in [(0.94, 19), (0.73, 15), (0.72, 14), (0.5, 10), (0.0, 1), (1.0, 19)] {
        let settings = Settings { generation_gap, migration_rate: 0.0, ..Settings::paper() };
        let mut genetic: Paper<3> = paper(settings, 5.0, 7);
        genetic.initialise(each(sphere));
        for _ in 0..5 {
            let people = |genetic: &Paper<3>| {
                genetic.subpopulations().each_ref().map(|s| s.chromosomes().map(|c| genetic.decode(&c)).to_vec())
            };
            let parents = people(&genetic);
            let mut batches = Vec::new();
            genetic.step(|candidates: &[[f64; 3]], objectives: &mut [f64]| {
                batches.push(candidates.to_vec());
                each(sphere)(candidates, objectives);
            });
            assert_eq!(batches.len(), 1, "one call for all subpopulations");
            assert_eq!(batches[0].len(), SUBPOPULATIONS * offspring);
            let children = batches[0].chunks(offspring);
            for ((parents, children), mut found) in parents.iter().zip(children).zip(people(&genetic)) {
                let mut expected = [&parents[..INDIVIDUALS - offspring], children].concat();
                expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
                found.sort_by(|a, b| a.partial_cmp(b).unwrap());
                assert_eq!(found, expected);
            }
        }
    }
}

/// Subpopulations whose individuals carry (home, rank at home) in their chromosome. Those of lower homes are better.
fn homes<const SUBPOPULATIONS: usize>() -> [Subpopulation<2, 20>; SUBPOPULATIONS] {
    std::array::from_fn(|home| {
        let mut subpopulation = Subpopulation::random(32, &mut random(8));
        let chromosomes: [[u32; 2]; 20] = std::array::from_fn(|rank| [home as u32, rank as u32]);
        subpopulation.reinsert(&chromosomes, &chromosomes.map(|[home, rank]| f64::from(100 * home + rank)));
        subpopulation
    })
}

#[test]
fn migrants_are_the_best_of_all_others_and_replace_the_worst() {
    const MIGRANTS: usize = 6;
    let (trials, mut random, mut arrived) = (3_000, random(9), [[[0; MIGRANTS]; 4]; 4]);
    for _ in 0..trials {
        let mut subpopulations = homes::<4>();
        migrate(&mut subpopulations, MIGRANTS, &mut random);
        for (home, subpopulation) in subpopulations.iter().enumerate() {
            let (own, foreign): (Vec<[u32; 2]>, Vec<_>) =
                subpopulation.chromosomes().iter().partition(|[from, _]| *from == home as u32);
            // Exactly the six worst of the old are gone, nobody arrives twice, and everyone brings its objective along.
            assert!(own.iter().map(|[_, rank]| *rank).eq(0..14));
            assert_eq!(foreign.iter().collect::<HashSet<_>>().len(), MIGRANTS);
            let brought = subpopulation.chromosomes().map(|[from, rank]| f64::from(100 * from + rank));
            assert_eq!(*subpopulation.objectives(), brought);
            assert!(brought.is_sorted());
            // An individual that was not on offer would be out of bounds here.
            foreign.iter().for_each(|[from, rank]| arrived[home][*from as usize][*rank as usize] += 1);
        }
    }
    for (home, arrived) in arrived.iter().enumerate() {
        for (from, arrived) in arrived.iter().enumerate().filter(|(from, _)| *from != home) {
            // Six of eighteen on offer are taken.
            arrived.iter().for_each(|&count| assert_binomial(count, trials, 1.0 / 3.0));
            assert!(arrived.iter().all(|&count| count > 0), "nobody ever went from {from} to {home}");
        }
    }
}

#[test]
fn two_subpopulations_exchange_everything_on_offer_and_one_alone_nothing() {
    let mut pair = homes::<2>();
    migrate(&mut pair, 10, &mut random(10));
    for subpopulation in &pair {
        let found: HashSet<[u32; 2]> = subpopulation.chromosomes().iter().copied().collect();
        assert_eq!(found, (0..2).flat_map(|home| (0..10).map(move |rank| [home, rank])).collect());
    }
    let mut alone = homes::<1>();
    migrate(&mut alone, 10, &mut random(10));
    assert_eq!(alone[0].chromosomes(), homes::<1>()[0].chromosomes());
    let mut nobody = homes::<2>();
    migrate(&mut nobody, 0, &mut random(10));
    assert_eq!(nobody[1].chromosomes(), homes::<2>()[1].chromosomes());
}

#[test]
#[should_panic(expected = "11 migrants are more than half of 20")]
fn more_than_half_cannot_migrate() {
    migrate(&mut homes::<2>(), 11, &mut random(11));
}

#[test]
fn subpopulations_are_isolated_from_one_migration_to_the_next() {
    // Without crossover and mutation everyone is a copy of somebody of the first population, so has a known home.
    let settings = Settings {
        crossover_probability: 0.0,
        mutation_probability: Some(0.0),
        migration_interval: 3,
        ..Settings::paper()
    };
    let mut genetic: Paper<9> = paper(settings, 5.0, 12);
    let homes = genetic.subpopulations().each_ref().map(|subpopulation| *subpopulation.chromosomes());
    let foreigners = |genetic: &Paper<9>| {
        [0, 1, 2, 3].map(|home: usize| {
            let chromosomes = genetic.subpopulations()[home].chromosomes();
            chromosomes.iter().filter(|chromosome| !homes[home].contains(chromosome)).count()
        })
    };
    for expected in [[0; 4], [0; 4], [6; 4]] {
        genetic.step(each(sphere));
        assert_eq!(foreigners(&genetic), expected, "in generation {}", genetic.generation());
    }
}
