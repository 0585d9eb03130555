//! The objective on vector lanes and the exact sensitivities, against the plain plant on a recording with noise in it.

use armid::board_setup::configuration;
use armid::capture::{self, Circumstances};
use armid::client::{Client, MovementPlan, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{Experiment, Fineness, Parameter, Residual, SearchBox, Searcher, Values, search};
use armid::link::SimulatedBoard;
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use rand::{RngExt, SeedableRng};
use shared::plant::Plant;
use shared::protocol::ControlLaw;

const SEED: u64 = 3;

fn record(robot: &Robot) -> Recording {
    let mut client = Client::connect(Box::new(SimulatedBoard::hidden(robot, SEED))).unwrap();
    client.prepare(&configuration(robot).unwrap(), Pose::DefaultsTo([0.0; 2]), false).unwrap();
    client.load_trajectory(&armid::trajectory_file::paper(3.65).unwrap()).unwrap();
    let plan = MovementPlan { law: ControlLaw::Position, settle_ns: 500_000_000 };
    let movement = client.run(&plan, &mut |_| {}).unwrap();
    let board = client.info().clone();
    let circumstances = Circumstances { robot, mode: Mode::P, trajectory: "paper".into(), board, seed: Some(SEED) };
    capture::recording(&movement, &circumstances, "run.csv".into())
}

/// The hidden robot's values, and many around them: from next to the truth, where little is left of the objective, to
/// far away.
fn candidates(robot: &Robot, count: usize) -> Vec<Values> {
    let hidden = HiddenRobot::draw(robot, SEED).plant(robot);
    let mut truth = Values::of_robot(robot);
    truth.f = hidden.arm.f;
    for joint in 0..2 {
        truth.viscous_nm_s_per_rad[joint] = hidden.drives[joint].viscous_friction_nm_s_per_rad;
        truth.coulomb_nm[joint] = hidden.drives[joint].coulomb_friction_nm;
        truth.torque_offset_nm[joint] = hidden.drives[joint].torque_offset_nm;
    }
    let mut random = rand::rngs::StdRng::seed_from_u64(8);
    (0..count)
        .map(|index| {
            let spread = if index == 0 { 0.0 } else { 10f64.powf(random.random_range(-4.0..-0.7)) };
            let mut values = truth;
            for f in &mut values.f {
                *f *= 1.0 + spread * random.random_range(-1.0..1.0);
            }
            values
        })
        .collect()
}

fn plants(robot: &Robot, candidates: &[Values]) -> Vec<Plant<f64>> {
    candidates.iter().map(|values| values.plant(robot)).collect()
}

#[test]
fn lanes_agree_with_the_plain_plant() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let candidates = candidates(&robot, 50);
    let plain: Vec<f64> = candidates.iter().map(|values| experiment.objective_counts2(values)).collect();
    assert!(plain[0] < 5e3 && plain.iter().any(|&y| y > 1e5), "{plain:?}");
    let on_lanes = experiment.objectives_counts2(&plants(&robot, &candidates));
    let off = plain.iter().zip(&on_lanes).map(|(plain, lane)| ((lane - plain) / plain).abs()).fold(0.0, f64::max);
    println!("off by {off:.1e} of the objective");
    assert!(off < 1e-9, "{off}");
}

#[test]
fn an_objective_does_not_depend_on_its_neighbours_or_on_threads() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let plants = plants(&robot, &candidates(&robot, 37));
    let together = experiment.objectives_counts2(&plants);
    let mut backwards = plants.clone();
    backwards.reverse();
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut reversed = one_thread.install(|| experiment.objectives_counts2(&backwards));
    reversed.reverse();
    assert_eq!(together, reversed);
    assert_eq!(experiment.objectives_counts2(&plants[5..6]), [together[5]]);
    assert!(experiment.objectives_counts2(&[]).is_empty());
}

#[test]
fn a_candidate_that_blows_up_leaves_its_neighbours_alone() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let mut candidates = candidates(&robot, 4);
    let alone = experiment.objectives_counts2(&plants(&robot, &candidates));
    // Nearly singular: accelerations beyond all bounds.
    candidates[1].f[6] = 0.7;
    candidates[2].f[0] = f64::NAN;
    let beside = experiment.objectives_counts2(&plants(&robot, &candidates));
    assert_eq!((alone[0], alone[3]), (beside[0], beside[3]));
    assert!(beside[2].is_nan(), "{}", beside[2]);
    let plain = experiment.objective_counts2(&candidates[1]);
    assert!(
        beside[1].is_finite() == plain.is_finite() && (!plain.is_finite() || beside[1] > 1e6),
        "{beside:?} {plain}"
    );
}

/// A search's single precision must order candidates as double precision does, near the truth, where a few thousand
/// counts² are left, as well as anywhere in the search ranges.
#[test]
fn the_search_agrees_with_the_plain_plant() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let mut candidates = candidates(&robot, 60);
    let mut random = rand::rngs::StdRng::seed_from_u64(9);
    while candidates.len() < 100 {
        let mut values = candidates[0];
        for (f, [low, high]) in values.f.iter_mut().zip(robot.search) {
            *f = random.random_range(low..high);
        }
        if values.arm(&robot).check_inertia().is_ok() {
            candidates.push(values);
        }
    }
    let plain: Vec<f64> = candidates.iter().map(|values| experiment.objective_counts2(values)).collect();
    assert!(plain[0] < 5e3 && plain.iter().any(|&y| y > 1e6), "{plain:?}");
    let fast = experiment.search_objectives_counts2(&plants(&robot, &candidates));
    let off = plain.iter().zip(&fast).map(|(plain, fast)| ((fast - plain) / plain).abs()).fold(0.0, f64::max);
    println!("off by {off:.1e} of the objective");
    assert!(off < 1e-4, "{off}");
    assert!(off > 0.0, "single precision was not used");
}

#[test]
fn a_search_does_not_depend_on_neighbours_threads_or_blow_ups() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let mut candidates = candidates(&robot, 61);
    let alone = experiment.search_objectives_counts2(&plants(&robot, &candidates));
    assert_eq!(experiment.search_objectives_counts2(&plants(&robot, &candidates)[5..6]), [alone[5]]);
    candidates[1].f[6] = 0.7;
    candidates[2].f[0] = f64::NAN;
    let mut backwards = plants(&robot, &candidates);
    backwards.reverse();
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut beside = one_thread.install(|| experiment.search_objectives_counts2(&backwards));
    beside.reverse();
    assert_eq!(alone[0], beside[0]);
    assert_eq!(alone[3..], beside[3..]);
    assert!(beside[2].is_nan(), "{}", beside[2]);
    // What single precision cannot follow is judged as in double precision.
    let double = experiment.objectives_counts2(&plants(&robot, &candidates[1..2]))[0];
    assert!(
        beside[1].to_bits() == double.to_bits() || (beside[1] - double).abs() < 1e-4 * double,
        "{} {double}",
        beside[1]
    );
}

/// The best of every generation has the objective of the plain plant, not that of single precision.
#[test]
fn a_search_gives_objectives_in_double_precision() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let known = candidates(&robot, 1)[0];
    let free: Vec<Parameter> = (0..9).map(Parameter::F).collect();
    let start = known.of(&free);
    let ranges: Vec<[f64; 2]> = start.iter().map(|f| [f - 0.01 * f.abs(), f + 0.01 * f.abs()]).collect();
    for searcher in [
        Searcher::Genetic(shared::genetic::Settings { generations: 3, ..Default::default() }),
        Searcher::EvolutionStrategy { settings: Default::default(), budget: 100 },
    ] {
        let place = SearchBox { free: &free, ranges: &ranges, known: &known, start: None, searcher };
        let found = search(&experiment, &place, 1, &|_| ()).unwrap();
        let plain = experiment.objective_counts2(&found.values);
        assert!(((found.objective_counts2 - plain) / plain).abs() < 1e-9, "{} {plain}", found.objective_counts2);
        assert_eq!(found.generations.last().unwrap().best_counts2, found.objective_counts2);
        // The same search on one thread is the same to the bit.
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let alone = one_thread.install(|| search(&experiment, &place, 1, &|_| ())).unwrap();
        assert_eq!((alone.values, alone.objective_counts2), (found.values, found.objective_counts2));
        assert_eq!(alone.generations, found.generations);
    }
}

/// Where a joint sticks or a command is at its limit, differences see the corner and derivatives one side of it; so the
/// two are compared by their sums over the movement.
#[test]
fn sensitivities_agree_with_differences() {
    let robot = Robot::paper();
    let experiment = Experiment::new(&robot, &[record(&robot)]).unwrap();
    let values = Values { lead: [Some(0.3), Some(0.1)], ..candidates(&robot, 1)[0] };
    let free: Vec<Parameter> = (0..9)
        .map(Parameter::F)
        .chain([Parameter::Viscous(0), Parameter::Coulomb(0), Parameter::Viscous(1), Parameter::Coulomb(1)])
        .chain([Parameter::Lead(0), Parameter::Lead(1)])
        .collect();
    for which in [Residual::Innovations, Residual::ClosedLoop(Fineness::Coarse), Residual::ClosedLoop(Fineness::Fine)] {
        let exact = experiment.sensitivities(&values, &free, which);
        for (&parameter, exact) in free.iter().zip(&exact) {
            let step = 1e-5 * values.get(parameter).abs().max(1e-3);
            let at = |sign: f64| {
                experiment.residual(&values.with(&[parameter], &[values.get(parameter) + sign * step]), which)
            };
            let (plus, minus) = (at(1.0), at(-1.0));
            for joint in 0..2 {
                let difference: Vec<f64> =
                    plus[0][joint].iter().zip(&minus[0][joint]).map(|(p, m)| (p - m) / (2.0 * step)).collect();
                let square = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
                let apart: Vec<f64> = difference.iter().zip(&exact[0][joint]).map(|(d, e)| d - e).collect();
                let share = (square(&apart) / square(&difference)).sqrt();
                assert!(share < 0.02, "{which:?}, {parameter:?}, joint {joint}: {share}");
            }
        }
    }
}
