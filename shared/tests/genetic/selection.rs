//! Coding, ranking and selection.

use proptest::prelude::*;
use shared::genetic::{Coding, Range, linear_ranking, shuffle, stochastic_universal_sampling};

use crate::common::{assert_binomial, assert_uniform, coding, random};

fn range() -> impl Strategy<Value = Range> {
    // For every other range of the second kind, low + (high - low) is not high.
    prop_oneof![
        (-1e3..1e3, 1e-3..1e3).prop_map(|(low, width)| Range { low, high: low + width }),
        (-1.0..-0.1, 1e-4..1e-2).prop_map(|(low, high)| Range { low, high }),
    ]
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
