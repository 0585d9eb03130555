use nalgebra::DMatrix;
use shared::arm::{SEARCH_HIGH, SEARCH_LOW};

use super::*;

/// Bounds around a PUMA 560 with a tool; a3 as the paper's ranges have it, whose f3 and f4 are 0.5 of f5 and f6.
fn bounds(upper_arm_m: f64) -> ArmBounds {
    ArmBounds {
        upper_arm_m,
        links: [
            LinkBounds {
                mass_kg: [10.0, 20.0],
                centre_x_m: [-0.3, 0.4],
                centre_y_m: [-0.1, 0.1],
                inertia_kg_m2: [0.05, 2.0],
                motor_inertia_kg_m2: [1e-4, 6e-4],
            },
            LinkBounds {
                mass_kg: [4.0, 10.0],
                centre_x_m: [-0.04, 0.04],
                centre_y_m: [-0.4, 0.0],
                inertia_kg_m2: [0.01, 1.0],
                motor_inertia_kg_m2: [1e-4, 6e-4],
            },
        ],
        gear_ratios: [107.8, -53.7],
        joints: ["2", "3"].map(String::from),
    }
}

fn links() -> [Link; 2] {
    [
        Link { mass_kg: 16.0, centre_m: [0.05, -0.01], inertia_kg_m2: 0.6, motor_inertia_kg_m2: 2e-4 },
        Link { mass_kg: 8.0, centre_m: [0.01, -0.2], inertia_kg_m2: 0.3, motor_inertia_kg_m2: 2e-4 },
    ]
}

/// Of the paper's inputs the motor inertias and gear ratios are printed (its range [1e-4, 1e-4] read as [1e-4, 6e-4]), and
/// f3, f4 show that it took a3 for 0.5 m: with them the width that f1 has beyond f2 and the ties come out as printed.
#[test]
fn ranges_reproduce_what_the_paper_prints_where_its_inputs_are_known() {
    let ranges = bounds(0.5).ranges();
    for end in 0..2 {
        let printed = [SEARCH_LOW, SEARCH_HIGH][end];
        assert!((ranges[0][end] - ranges[1][end] - (printed[0] - printed[1])).abs() < 0.011, "{ranges:?}");
        assert!((ranges[2][end] / ranges[4][end] - printed[2] / printed[4]).abs() < 1e-9);
    }
    // f6 ends at 0, where there is no ratio.
    assert!((ranges[3][0] / ranges[5][0] - SEARCH_LOW[3] / SEARCH_LOW[5]).abs() < 1e-9);
}

/// Links drawn within bounds never leave the ranges, and links at the right corner reach their ends.
#[test]
fn ranges_hold_every_arm_and_no_more() {
    let bounds = bounds(0.4318);
    let ranges = bounds.ranges();
    let mut random = crate::random::Random::new(4, 9);
    let mut reached = ranges.map(|[low, high]| [high, low]);
    for _ in 0..200_000 {
        // Corners as well as the inside: extremes lie at corners, but for centres that pass through zero.
        let mut within = |[low, high]: Bounds| match random.between(0.0, 4.0) as u32 {
            0 => low,
            1 => high,
            2 if low < 0.0 && high > 0.0 => 0.0,
            _ => random.between(low, high),
        };
        let links = bounds.links.map(|link| Link {
            mass_kg: within(link.mass_kg),
            centre_m: [within(link.centre_x_m), within(link.centre_y_m)],
            inertia_kg_m2: within(link.inertia_kg_m2),
            motor_inertia_kg_m2: within(link.motor_inertia_kg_m2),
        });
        for (index, value) in bounds.f(&links).into_iter().enumerate() {
            let [low, high] = ranges[index];
            assert!(value >= low - 1e-9 && value <= high + 1e-9, "f{} = {value} outside {low} to {high}", index + 1);
            reached[index] = [reached[index][0].min(value), reached[index][1].max(value)];
        }
    }
    for (index, ([low, high], [least, most])) in ranges.into_iter().zip(reached).enumerate() {
        let width = high - low;
        assert!(least - low < 0.1 * width && high - most < 0.1 * width, "f{}: {least} {most}", index + 1);
    }
}

#[test]
fn the_f_of_possible_links_is_possible() {
    let bounds = bounds(0.4318);
    let f = bounds.f(&links());
    let (found, violations) = bounds.links_of(&f);
    assert!(violations.is_empty(), "{violations:?}");
    for (found, wanted) in bounds.f(&found).into_iter().zip(f) {
        assert!((found - wanted).abs() < 1e-9);
    }
    let nearest = nearest(&bounds, &f, &DMatrix::identity(9, 9)).unwrap();
    assert!(nearest.distance < 1e-4, "{nearest:?}");
}

#[test]
fn the_bound_that_stands_in_the_way_is_named() {
    let bounds = bounds(0.4318);
    // A rotor of 10e-4 kg m² is beyond its bound of 6e-4, and shows in f1 alone.
    let mut links = links();
    links[1].motor_inertia_kg_m2 = 1e-3;
    let (_, violations) = bounds.links_of(&bounds.f(&links));
    assert_eq!(violations.len(), 1, "{violations:?}");
    assert!(violations[0].quantity.contains("motor 3"), "{violations:?}");
    assert!((violations[0].value - 1e-3).abs() < 1e-9);
}

/// The nearest f keeps to all bounds, the inertias' upper ones included, and no f of links near it is nearer.
#[test]
fn the_nearest_f_is_possible_and_nearest() {
    let bounds = bounds(0.4318);
    let mut outside = links();
    outside[1].motor_inertia_kg_m2 = 1e-3;
    outside[1].inertia_kg_m2 = 1.6;
    let f = bounds.f(&outside);
    let mut information = DMatrix::identity(9, 9);
    information[(6, 6)] = 0.1;
    let found = nearest(&bounds, &f, &information).unwrap();
    let (links, violations) = bounds.links_of(&found.f);
    // The solver stops within its own tolerance of the bounds.
    let off = |v: &Violation| (v.bounds[0] - v.value).max(v.value - v.bounds[1]) / (v.bounds[1] - v.bounds[0]);
    assert!(violations.iter().all(|violation| off(violation) < 1e-3), "{violations:?}");
    let distance =
        |f2: &[f64; 9]| -> f64 { (0..9).map(|i| information[(i, i)] * (f2[i] - f[i]).powi(2)).sum::<f64>().sqrt() };
    assert!((distance(&found.f) - found.distance).abs() < 1e-9);
    let mut random = crate::random::Random::new(1, 9);
    for _ in 0..20_000 {
        let mut near = |value: f64, [low, high]: Bounds| {
            (value + 0.02 * (high - low) * random.between(-1.0, 1.0)).clamp(low, high)
        };
        let moved: [Link; 2] = std::array::from_fn(|index| {
            let (link, known) = (links[index], bounds.links[index]);
            Link {
                mass_kg: near(link.mass_kg, known.mass_kg),
                centre_m: [near(link.centre_m[0], known.centre_x_m), near(link.centre_m[1], known.centre_y_m)],
                inertia_kg_m2: near(link.inertia_kg_m2, known.inertia_kg_m2),
                motor_inertia_kg_m2: near(link.motor_inertia_kg_m2, known.motor_inertia_kg_m2),
            }
        });
        assert!(distance(&bounds.f(&moved)) > found.distance - 1e-3, "{moved:?}");
    }
}
