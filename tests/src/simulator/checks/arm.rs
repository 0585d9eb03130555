//! The two ways of writing the dynamics, derived separately, must agree.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::simulator::noise::{Purpose, RandomStream};
use crate::simulator::{Arm, BaseParameters, EquationsOfMotion, LinkMasses, Robot};

const GRAVITY_M_S2: f64 = 9.81;

fn drawn_base(seed: u64) -> BaseParameters {
    Robot::draw(seed).arm.base_parameters()
}

#[test]
fn newton_euler_agrees_with_the_base_parameters() {
    let mut random = RandomStream::new(1, Purpose::Robot);
    let mut largest = 0.0_f64;
    for seed in 0..200 {
        let base = drawn_base(seed);
        let links = LinkMasses::with_base_parameters(&base).expect("drawn robots are real arms");
        for (ours, theirs) in links.base_parameters().0.iter().zip(base.0) {
            assert!((ours - theirs).abs() < 1e-12);
        }
        let mut pair = |scale: f64| [scale * random.symmetric(), scale * random.symmetric()];
        let (angle, velocity, acceleration) = (pair(PI), pair(5.0), pair(50.0));
        let equations = base.equations(angle, velocity, GRAVITY_M_S2);
        let mass = equations.mass_kg_m2;
        let from_links = links.required_torque_nm(angle, velocity, acceleration, GRAVITY_M_S2);
        for joint in 0..2 {
            let from_base =
                mass[joint][0] * acceleration[0] + mass[joint][1] * acceleration[1] + equations.bias_nm[joint];
            largest = largest.max((from_base - from_links[joint]).abs());
        }
        let of_links = links.equations(angle, velocity, GRAVITY_M_S2);
        let entries = |equations: &EquationsOfMotion| {
            let [[first, second], [third, fourth]] = equations.mass_kg_m2;
            [first, second, third, fourth, equations.bias_nm[0], equations.bias_nm[1]]
        };
        for (ours, theirs) in entries(&of_links).iter().zip(entries(&equations)) {
            largest = largest.max((ours - theirs).abs());
        }
        let energy = |arm: Arm| arm.energy_j(angle, velocity, GRAVITY_M_S2);
        largest = largest.max((energy(Arm::Base(base)) - energy(Arm::Links(links))).abs());
    }
    println!("largest disagreement over 200 arms and states: {largest:.1e} (N m, kg m², J)");
    assert!(largest < 1e-11);
}

#[test]
fn the_reference_masses_give_the_reference_row() {
    let from_masses = LinkMasses::reference().base_parameters();
    for (index, (computed, row)) in from_masses.0.iter().zip(BaseParameters::REFERENCE.0).enumerate() {
        assert!((computed - row).abs() < 2e-3, "f{}: {computed} from masses, {row} in the table", index + 1);
    }
}

#[test]
fn a_load_changes_the_parameters_as_its_mass_does() {
    // The same load added to the forearm as a body: common centre, inertias moved to it (Steiner).
    let (mass_kg, x_m, y_m, inertia_kg_m2) = (1.7, 0.03, -0.5, 0.004);
    let mut links = LinkMasses::reference();
    let before = links.base_parameters();
    let forearm = &mut links.forearm;
    let total = forearm.mass_kg + mass_kg;
    let between = [x_m - forearm.centre_m[0], y_m - forearm.centre_m[1]];
    forearm.inertia_kg_m2 +=
        inertia_kg_m2 + forearm.mass_kg * mass_kg / total * (between[0].powi(2) + between[1].powi(2));
    for (centre, offset) in forearm.centre_m.iter_mut().zip(between) {
        *centre += mass_kg / total * offset;
    }
    forearm.mass_kg = total;
    let expected = links.base_parameters();
    for (computed, expected) in before.with_load(mass_kg, x_m, y_m, inertia_kg_m2).0.iter().zip(expected.0) {
        assert!((computed - expected).abs() < 1e-12);
    }
}

#[test]
fn weight_pulls_the_way_the_conventions_say() {
    let holding = |angle: [f64; 2]| BaseParameters::REFERENCE.equations(angle, [0.0; 2], GRAVITY_M_S2).bias_nm;
    // Straight out: both joints must push up, which is negative, the shoulder more.
    let straight_out = holding([0.0, FRAC_PI_2]);
    assert!(straight_out[0] < straight_out[1] && straight_out[1] < -20.0, "{straight_out:?}");
    // Straight up: only the small offsets of the centres are left.
    let straight_up = holding([-FRAC_PI_2, FRAC_PI_2]);
    assert!(straight_up.iter().all(|torque| torque.abs() < 1.5), "{straight_up:?}");
    // Forearm up on a level upper arm: nearly nothing at the elbow.
    assert!(holding([0.0, 0.0])[1].abs() < 0.5);
}

#[test]
fn physical_means_positive_definite_at_every_elbow_angle() {
    let least_determinant = |base: &BaseParameters| {
        (0..3600)
            .map(|point| base.equations([0.0, f64::from(point) * PI / 1800.0], [0.0; 2], 0.0).mass_kg_m2)
            .map(|mass| (mass[0][0] * mass[1][1] - mass[0][1] * mass[1][0]).min(mass[0][0]))
            .fold(f64::INFINITY, f64::min)
    };
    let mut random = RandomStream::new(2, Purpose::Robot);
    let mut seen = [0_usize; 2];
    for _ in 0..2000 {
        // Anywhere in the paper's search range, but f1 above f2, so that only definiteness decides.
        let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
        let f2 = between(0.0, 2.33);
        let (f1, f3, f4, f7) = (f2 + between(0.01, 1.7), between(-0.2, 0.2), between(-1.25, 0.0), between(2.23, 8.0));
        let base = BaseParameters([f1, f2, f3, f4, 0.0, 0.0, f7, 0.0, 0.0]);
        let least = least_determinant(&base);
        // The grid may miss the very bottom by a little.
        if least.abs() > 1e-4 {
            assert_eq!(base.is_physical(), least > 0.0, "{base:?}: least determinant {least}");
        }
        seen[usize::from(base.is_physical())] += 1;
    }
    assert!(seen.iter().all(|&count| count > 20), "the draw should show both kinds: {seen:?}");
    assert!(BaseParameters::REFERENCE.is_physical() && BaseParameters::PAPER.is_physical());
    assert_eq!(LinkMasses::with_base_parameters(&BaseParameters::PAPER), None);
}

#[test]
fn drawn_robots_spread_around_the_reference() {
    let robots: Vec<Robot> = (0..500).map(Robot::draw).collect();
    assert_eq!(robots[3], Robot::draw(3));
    for index in 0..9 {
        let centre = BaseParameters::REFERENCE.0[index];
        let spread = match index {
            4 | 7 => 0.05,
            2 => 0.05 * 0.4318,
            _ => 0.1 * centre.abs(),
        };
        let values = robots.iter().map(|robot| robot.arm.base_parameters().0[index] - centre);
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        assert!(low >= -1.001 * spread && high <= 1.001 * spread, "f{}: {low} {high} {spread}", index + 1);
        assert!(low < -0.95 * spread && high > 0.95 * spread, "f{}: {low} {high} {spread}", index + 1);
    }
}
