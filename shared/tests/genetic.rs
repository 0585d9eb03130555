//! The genetic algorithm: every operator has the statistics its definition demands, and the whole converges.
//!
//! Statistical tests run on fixed seeds, so they never flicker. Their bounds are 5 standard deviations of a binomial
//! count, or the 1 - 1e-6 quantile of chi-square: at another seed, code that is right would exceed one with a
//! probability below 1e-6 (times the number of counts looked at).

use std::collections::HashSet;

use proptest::prelude::*;
use rand_core::{Infallible, Rng, SeedableRng, TryRng};
use rand_pcg::Pcg32;
use shared::genetic::{
    Coding, Error, Genetic, Range, Settings, Subpopulation, linear_ranking, migrate, mutate, shuffle,
    single_point_crossover, stochastic_universal_sampling,
};

const INDIVIDUALS: usize = 20;
const SUBPOPULATIONS: usize = 4;
type Paper<const GENES: usize> = Genetic<GENES, INDIVIDUALS, SUBPOPULATIONS, Pcg32>;

fn random(seed: u64) -> Pcg32 {
    Pcg32::seed_from_u64(seed)
}

fn paper<const GENES: usize>(settings: Settings, half_width: f64, seed: u64) -> Paper<GENES> {
    Genetic::new(settings, [Range { low: -half_width, high: half_width }; GENES], random(seed)).unwrap()
}

/// Makes an objective of one candidate into one of a batch.
fn each<const GENES: usize>(objective: impl Fn(&[f64; GENES]) -> f64) -> impl Fn(&[[f64; GENES]], &mut [f64]) {
    move |candidates, objectives| {
        for (candidate, value) in candidates.iter().zip(objectives) {
            *value = objective(candidate);
        }
    }
}

fn sphere<const GENES: usize>(genes: &[f64; GENES]) -> f64 {
    genes.iter().map(|x| x * x).sum()
}

fn rastrigin<const GENES: usize>(genes: &[f64; GENES]) -> f64 {
    genes.iter().map(|x| x * x + 10.0 * (1.0 - (core::f64::consts::TAU * x).cos())).sum()
}

#[track_caller]
fn assert_binomial(count: usize, trials: usize, probability: f64) {
    let (mean, variance) = (trials as f64 * probability, trials as f64 * probability * (1.0 - probability));
    assert!((count as f64 - mean).abs() <= 5.0 * variance.sqrt(), "{count} of {trials}, expected {mean:.1}");
}

#[track_caller]
fn assert_uniform(counts: &[usize]) {
    let mean = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
    assert!(mean >= 20.0, "too few for chi-square");
    let chi_square: f64 = counts.iter().map(|&count| (count as f64 - mean).powi(2) / mean).sum();
    // Wilson and Hilferty's approximation of the quantile 1 - 1e-6, which is 4.75 standard deviations of a normal.
    let spread = 2.0 / (9.0 * (counts.len() - 1) as f64);
    let limit = (counts.len() - 1) as f64 * (1.0 - spread + 4.75 * spread.sqrt()).powi(3);
    assert!(chi_square < limit, "chi-square {chi_square:.1} over {limit:.1}: {counts:?}");
}

/// The string of bits a chromosome stands for, most significant bit of each gene first.
fn bits(chromosome: &[u32], bits_per_gene: u32) -> Vec<u32> {
    chromosome.iter().flat_map(|gene| (0..bits_per_gene).rev().map(move |bit| gene >> bit & 1)).collect()
}

fn chromosome<const GENES: usize>(bits_per_gene: u32, random: &mut Pcg32) -> [u32; GENES] {
    Subpopulation::<GENES, 1>::random(bits_per_gene, random).chromosomes()[0]
}

// ---------------------------------------------------------------------------------------------------------- coding

fn range() -> impl Strategy<Value = Range> {
    // For every other range of the second kind, low + (high - low) is not high.
    prop_oneof![
        (-1e3..1e3, 1e-3..1e3).prop_map(|(low, width)| Range { low, high: low + width }),
        (-1.0..-0.1, 1e-4..1e-2).prop_map(|(low, high)| Range { low, high }),
    ]
}

fn coding() -> impl Strategy<Value = Coding> {
    prop_oneof![Just(Coding::Binary), Just(Coding::Gray)]
}

proptest! {
    #[test]
    fn a_decoded_encoding_is_within_half_a_step(
        coding in coding(), range in range(), bits in 1_u32..=32, fraction in 0.0..=1.0,
    ) {
        let value = range.low + fraction * (range.high - range.low);
        let half_step = 0.5 * (range.high - range.low) / (2_f64.powi(bits as i32) - 1.0);
        let rounding = 4.0 * f64::EPSILON * range.low.abs().max(range.high.abs());
        let decoded = coding.decode(coding.encode(value, range, bits), range, bits);
        prop_assert!((decoded - value).abs() <= half_step + rounding, "{value} became {decoded}");
    }

    #[test]
    fn both_ends_are_reached_exactly_and_beyond_them_is_clamped(
        coding in coding(), range in range(), bits in 1_u32..=32,
    ) {
        for beyond in [0.0, 1.0, f64::INFINITY] {
            prop_assert_eq!(coding.decode(coding.encode(range.low - beyond, range, bits), range, bits), range.low);
            prop_assert_eq!(coding.decode(coding.encode(range.high + beyond, range, bits), range, bits), range.high);
        }
    }

    #[test]
    fn every_gene_is_the_encoding_of_what_it_decodes_to(coding in coding(), gene: u32, bits in 1_u32..=32) {
        let (gene, range) = (gene >> (32 - bits), Range { low: -1.25, high: 0.5 });
        prop_assert_eq!(coding.encode(coding.decode(gene, range, bits), range, bits), gene);
    }

    #[test]
    fn neighbouring_levels_differ_in_one_bit_of_a_gray_gene(level: u32, bits in 1_u32..=32) {
        let levels = 1_u64 << bits;
        let level = u64::from(level) % (levels - 1);
        let range = Range { low: 0.0, high: (levels - 1) as f64 };
        let gene = |level: u64| Coding::Gray.encode(level as f64, range, bits);
        prop_assert_eq!((gene(level) ^ gene(level + 1)).count_ones(), 1);
    }
}

#[test]
fn a_binary_gene_is_the_level_itself_and_a_gray_gene_the_published_code() {
    let range = Range { low: 0.0, high: 7.0 };
    let genes = |coding: Coding| [0, 1, 2, 3, 4, 5, 6, 7].map(|level| coding.encode(f64::from(level), range, 3));
    assert_eq!(genes(Coding::Binary), [0, 1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(genes(Coding::Gray), [0b000, 0b001, 0b011, 0b010, 0b110, 0b111, 0b101, 0b100]);
}

// --------------------------------------------------------------------------------------------- ranking, selection

proptest! {
    #[test]
    fn fitness_falls_evenly_from_the_pressure_to_its_complement_and_sums_to_the_number(
        steps in prop::array::uniform20(1e-6..1.0), pressure in 1.0..=2.0,
    ) {
        let mut objective = -3.0;
        let objectives = steps.map(|step| { objective += step; objective });
        let fitness = linear_ranking(&objectives, pressure);
        prop_assert!((fitness.iter().sum::<f64>() - 20.0).abs() < 1e-12);
        prop_assert!((fitness[0] - pressure).abs() < 1e-14);
        prop_assert!((fitness[19] - (2.0 - pressure)).abs() < 1e-14);
        for pair in fitness.windows(2) {
            prop_assert!((pair[0] - pair[1] - 2.0 * (pressure - 1.0) / 19.0).abs() < 1e-14);
        }
    }

    #[test]
    fn equal_objectives_have_the_mean_fitness_of_their_positions(mut objectives in prop::array::uniform20(0_u8..5)) {
        objectives.sort();
        let fitness = linear_ranking(&objectives.map(f64::from), 2.0);
        let untied = linear_ranking(&std::array::from_fn::<_, 20, _>(|rank| rank as f64), 2.0);
        for value in objectives {
            let tied: Vec<usize> = (0..20).filter(|&rank| objectives[rank] == value).collect();
            let mean = tied.iter().map(|&rank| untied[rank]).sum::<f64>() / tied.len() as f64;
            prop_assert!(tied.iter().all(|&rank| (fitness[rank] - mean).abs() < 1e-14));
        }
    }

    #[test]
    fn everyone_gets_its_expected_copies_rounded_down_or_up(
        fitness in prop::collection::vec(prop_oneof![1 => Just(0.0), 4 => 0.0..2.0], 1..40),
        count in 1_usize..50, seed: u64,
    ) {
        let sum: f64 = fitness.iter().sum();
        prop_assume!(sum > 0.01);
        let mut selected = vec![usize::MAX; count];
        stochastic_universal_sampling(&fitness, &mut selected, &mut random(seed));
        prop_assert!(selected.is_sorted());
        for (individual, fitness) in fitness.iter().enumerate() {
            let copies = selected.iter().filter(|&&parent| parent == individual).count() as f64;
            let expected = count as f64 * fitness / sum;
            // The margin is for an expectation that is whole but for rounding.
            prop_assert!((expected - 1e-9).floor() <= copies && copies <= (expected + 1e-9).ceil());
        }
        prop_assert!(selected.iter().all(|&parent| fitness[parent] > 0.0));
    }
}

#[test]
fn ranking_agrees_with_the_example_of_the_toolbox_manual() {
    let fitness = linear_ranking(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0], 2.0);
    let printed = [2.0, 1.77, 1.55, 1.33, 1.11, 0.88, 0.66, 0.44, 0.22, 0.0];
    // The manual cuts off after two digits.
    assert!(fitness.iter().zip(printed).all(|(fitness, printed)| (0.0..0.01).contains(&(fitness - printed))));
}

#[test]
fn individuals_of_infinite_objective_rank_last_together() {
    let fitness = linear_ranking(&[1.0, f64::INFINITY, f64::INFINITY], 2.0);
    assert_eq!(fitness, [2.0, 0.5, 0.5]);
}

#[test]
fn sampling_is_unbiased() {
    let fitness: [f64; 20] = std::array::from_fn(|rank| 2.0 * (19 - rank) as f64 / 19.0);
    let (trials, mut copies, mut random) = (20_000, [0; 20], random(1));
    for _ in 0..trials {
        let mut selected = [0; 19];
        stochastic_universal_sampling(&fitness, &mut selected, &mut random);
        selected.iter().for_each(|&parent| copies[parent] += 1);
    }
    for (copies, fitness) in copies.iter().zip(fitness) {
        let expected = 19.0 * fitness / 20.0;
        // Of every draw only the copy beyond floor(expected) is random.
        assert_binomial(copies - trials * expected as usize, trials, expected.fract());
    }
}

#[test]
fn every_order_is_equally_likely() {
    let (mut random, mut orders) = (random(2), [0; 4 * 4 * 4 * 4]);
    for _ in 0..24_000 {
        let mut items = [0, 1, 2, 3];
        shuffle(&mut items, &mut random);
        orders[items.iter().fold(0, |order, item| 4 * order + item)] += 1;
    }
    let seen: Vec<usize> = orders.into_iter().filter(|&count| count > 0).collect();
    assert_eq!(seen.len(), 24);
    assert_uniform(&seen);
}

// ------------------------------------------------------------------------------------------ crossover, mutation

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
    let settings = Settings { crossover_probability: 0.0, migration_rate: 0.0, ..Settings::default() };
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
    let settings = Settings { crossover_probability: 1.0, mutation_probability: Some(0.0), ..Settings::default() };
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

// ------------------------------------------------------------------------------------------------- reinsertion

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
        let settings = Settings { generation_gap, migration_rate: 0.0, ..Settings::default() };
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

// --------------------------------------------------------------------------------------------------- migration

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
        ..Settings::default()
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

// ---------------------------------------------------------------------------------------------------- the whole

#[test]
fn the_default_is_what_the_paper_lists() {
    let settings = Settings::default();
    assert_eq!(
        (settings.selective_pressure, settings.crossover_probability, settings.migration_rate, settings.generation_gap),
        (2.0, 0.6, 0.3, 0.94)
    );
    assert_eq!((settings.generations, settings.coding), (40, Coding::Binary));
}

#[test]
fn a_run_reports_the_first_population_and_every_generation() {
    let (mut genetic, mut seen, mut evaluations) = (paper::<9>(Settings::default(), 5.0, 13), Vec::new(), 0);
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
    let mut genetic: Paper<9> = paper(Settings::default(), 5.0, 14);
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
        let (mut genetic, mut trace) = (paper::<9>(Settings::default(), 5.12, seed), Vec::new());
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
            migration_rate, migration_interval, generations: 15,
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
            let worst = searches(Settings { coding, ..Settings::default() }, objective).into_iter().fold(0.0, f64::max);
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
        let finals = searches(Settings { coding, ..Settings::default() }, sphere);
        assert!(finals.iter().all(|&objective| objective < 5.0), "{coding:?}: {finals:?}");
    }
}

#[test]
fn given_time_gray_coding_reaches_the_resolution_and_binary_coding_is_caught_at_a_hamming_cliff() {
    let run = |coding| searches(Settings { coding, generations: 400, ..Settings::default() }, sphere);
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
        let mut genetic: Paper<2> = paper(Settings::default(), 1.0, seed);
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
    let mut genetic: Paper<2> = paper(Settings::default(), 1.0, 17);
    genetic.run(|_: &[[f64; 2]], _: &mut [f64]| (), |genetic| assert_eq!(genetic.best().1, f64::INFINITY));
    // And whatever is found afterwards wins.
    genetic.step(each(sphere));
    assert!(genetic.best().1.is_finite());
}

#[test]
fn a_known_start_takes_part() {
    let mut genetic: Paper<2> = paper(Settings::default(), 1.0, 18);
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
    let mut genetic: Paper<2> = paper(Settings::default(), 1.0, 19);
    let error = genetic.seed_individual(0, 0, [0.0, f64::NAN]).unwrap_err();
    assert!(matches!(error, Error::Seed { gene: 1, value } if value.is_nan()));
    let message = error.to_string();
    assert!(message.contains("gene 1") && message.contains("NaN") && message.contains("finite"), "{message}");
}

#[test]
fn a_changed_objective_takes_effect_on_initialising_again() {
    let mut genetic: Paper<2> = paper(Settings::default(), 1.0, 20);
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
    let limits: [(&str, Change, [f64; 2], [f64; 2]); 7] = [
        ("bits_per_gene", |s, x| s.bits_per_gene = x as u32, [1.0, 32.0], [0.0, 33.0]),
        ("selective_pressure", |s, x| s.selective_pressure = x, [1.0, 2.0], [0.99, 2.01]),
        ("crossover_probability", |s, x| s.crossover_probability = x, [0.0, 1.0], [-0.01, 1.01]),
        ("mutation_probability", |s, x| s.mutation_probability = Some(x), [0.0, 1.0], [-0.01, f64::NAN]),
        ("generation_gap", |s, x| s.generation_gap = x, [0.0, 1.0], [-0.01, 1.01]),
        ("migration_rate", |s, x| s.migration_rate = x, [0.0, 0.5], [f64::NAN, 0.51]),
        ("migration_interval", |s, x| s.migration_interval = x as u32, [1.0, 4_294_967_295.0], [0.0, 0.0]),
    ];
    for (name, change, allowed, refused) in limits {
        let with = |value| {
            let mut settings = Settings::default();
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
        let error = Paper::<2>::new(Settings::default(), [good, Range { low, high }], random(22)).unwrap_err();
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
