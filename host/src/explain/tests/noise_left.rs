//! What is left, and what is expected of it: noise is no effect, and what is no noise gets no name.

use nalgebra::DVector;

use super::*;
use crate::explain::noise::JointNoise;
use crate::explain::nulls::closed_loop;
use crate::random::Random;

/// An irregular torque of 5 % of the Coulomb friction is no robot's noise.
#[test]
fn more_noise_than_a_robot_has_is_called_unknown() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let truth = Hypothesis { base: baseline.values.of(&baseline.free), named: Vec::new() };
    let noise = NullNoise { torque_nm: [0.0, 0.05 * model.coulomb_nm[1]], ..NOISE };
    let recordings: Vec<Recording> = [(3.65, 50), (5.0, 51), (4.3, 52)]
        .into_iter()
        .map(|(period_s, seed)| {
            let movement = crate::trajectory_file::paper(period_s).expect("a period");
            simulated(&robot, &baseline, &truth, &movement, &noise, seed).expect("a recording")
        })
        .collect();
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    let (fitted, check) = recordings.split_at(2);
    let explanation = explain(&robot, fitted, check, Some(&model), &options, &|_| ()).expect("an explanation");
    assert_eq!((explanation.verdict, explanation.effects.len()), (Verdict::Unknown, 0), "{:?}", explanation.sentences);
    let told = |sentence: &String| sentence.starts_with("joint 3: an irregular torque");
    assert!(explanation.sentences.iter().any(told), "{:?}", explanation.sentences);
    // Programs are told as well.
    let left = explanation.to_json()["left"][1].clone();
    assert!(left["joint"] == "3" && left["is_more_than_noise"] == true, "{left}");
    assert!((0.03..0.1).contains(&left["share_of_coulomb"].as_f64().unwrap_or(0.0)), "{left}");
}

/// Fits as likely as the one found leave on average, in the recording kept back, what is expected of them.
#[test]
fn what_a_fit_could_not_know_is_expected_of_what_was_kept_back() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let wave = |records: usize| Instance::new(kind("cogging").expect("an effect"), 1, &[0.02, 0.7, 3.3], records);
    let recordings = recordings(&robot, &baseline, vec![wave(1)]);
    let (fitted, check) = recordings.split_at(2);
    let experiments = [fitted, check].map(|part| Experiment::new(&robot, part).expect("recordings"));
    let rows = experiments.each_ref().map(rows::Rows::new);
    let engine = |part: usize| {
        let setting = Setting { experiment: &experiments[part], rows: &rows[part], current_sigma_a: None };
        Engine::new(setting, &baseline)
    };
    let (train, check) = (engine(0), engine(1));
    let noise = [JointNoise { torque_counts2: 20.0, ..JointNoise::white(1.0 / 12.0) }; 2];
    let hypothesis = Hypothesis::baseline(&baseline, &[wave(2)]);
    let fitted = train.refit(&hypothesis, &train.weights(&noise), &[], Free::All, 0).expect("a fit");
    let kept_back = held_out::adapted(&check, &hypothesis, &check.weights(&noise));

    let (free, covariance) = train.covariance(&fitted, &train.weights(&noise));
    let factor = covariance.cholesky().expect("a covariance").l();
    let innovations = check.innovations(&kept_back);
    let mut random = Random::new(3, 0);
    let draws = 60;
    let mut sum = 0.0;
    for _ in 0..draws {
        let errors = &factor * DVector::from_fn(free.len(), |_, _| random.normal());
        let mut point = fitted.hypothesis.point();
        free.iter().zip(errors.iter()).for_each(|(&place, error)| point[place] += error);
        let drawn = fitted.hypothesis.at(&point);
        let mut other = Hypothesis { base: drawn.base, ..kept_back.clone() };
        other.named[0].common.clone_from(&drawn.named[0].common);
        let mut left = check.innovations(&other);
        for (left, right) in left.iter_mut().flatten().zip(innovations.iter().flatten()) {
            left.iter_mut().zip(right).for_each(|(left, right)| *left -= right);
        }
        sum += check.gap(&left).powi(2) / f64::from(draws);
    }
    let expected = held_out::missed_counts2(&train, &fitted, &noise, &check, &kept_back);
    assert!((expected / sum - 1.0).abs() < 0.3, "{expected} expected, {sum} left");
    assert!(expected > 0.0 && expected < check.floor(&noise).powi(2), "{expected}");
}

/// What a recording becomes on a robot that lacks nothing and has a torque noise of 1 % of its Coulomb friction, but stands on a
/// floor that shakes: an amplitude of `torque_nm` at joint 2's motor, which nobody recorded.
fn shaken(
    robot: &Robot,
    baseline: &Baseline,
    mut recording: Recording,
    torque_nm: f64,
    frequency_hz: f64,
) -> Recording {
    let mut experiment = Experiment::new(robot, std::slice::from_ref(&recording)).expect("a recording");
    for (k, added) in experiment.segments[0].added_torque_nm.iter_mut().enumerate() {
        let angle = std::f64::consts::TAU * frequency_hz * k as f64 * robot.record_period_s;
        *added = [torque_nm * angle.sin(), 0.0];
    }
    let truth = Hypothesis { base: baseline.values.of(&baseline.free), named: Vec::new() };
    let candidate = truth.candidate(baseline, &experiment).expect("an arm");
    let noise = NullNoise { torque_nm: baseline.values.coulomb_nm.map(|coulomb_nm| 0.01 * coulomb_nm), ..NOISE };
    let run = closed_loop(&experiment, &candidate, 0, &noise, &mut Random::new(7, recording.tick.len() as u64));
    recording.error_counts = run.error_counts.to_vec();
    recording.current_a = run.current_a.to_vec();
    recording
}

/// A tone as large as the noise beside it is taken for noise by whatever estimates that; it stands in one line, though (the
/// nearest to 2.7 Hz in recordings of some 5 s).
#[test]
fn a_floor_that_shakes_is_called_unknown() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let shaken = |recording| shaken(&robot, &baseline, recording, 0.01 * model.coulomb_nm[0], 2.7);
    let recordings: Vec<Recording> = recordings(&robot, &baseline, Vec::new()).into_iter().map(shaken).collect();
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    let (fitted, check) = recordings.split_at(2);
    let explanation = explain(&robot, fitted, check, Some(&model), &options, &|_| ()).expect("an explanation");
    assert_eq!((explanation.verdict, explanation.effects.len()), (Verdict::Unknown, 0), "{:?}", explanation.sentences);
    let told = |sentence: &String| sentence.starts_with("joint 2: a tone of 2.6");
    assert!(explanation.sentences.iter().any(told), "{:?}", explanation.sentences);
    let tone_hz = explanation.to_json()["left"][0]["tone_hz"].as_f64();
    assert!(tone_hz.is_some_and(|tone_hz| (2.6..2.7).contains(&tone_hz)), "{tone_hz:?}");
}

/// A push is found in noise because it is looked for; χ² falls with it by more than what proves other effects.
#[test]
fn a_push_looked_for_in_noise_is_no_proof_of_one() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let contact =
        |start_s: f64| Instance::new(kind("external-contact").expect("an effect"), 0, &[0.6, 0.2, start_s], 1);
    let noise_nm = [0, 1].map(|joint| 0.015 * model.coulomb_nm[joint]);
    let truth = Hypothesis::baseline(&baseline, &[]);
    let gain = |seed: u64| {
        let noise = NullNoise { torque_nm: noise_nm, ..NOISE };
        let movement: Trajectory = crate::trajectory_file::paper(4.3).expect("a period");
        let recording = simulated(&robot, &baseline, &truth, &movement, &noise, seed).expect("a recording");
        let experiment = Experiment::new(&robot, std::slice::from_ref(&recording)).expect("a recording");
        let rows = rows::Rows::new(&experiment);
        let engine = Engine::new(Setting { experiment: &experiment, rows: &rows, current_sigma_a: None }, &baseline);
        let alone = Hypothesis::baseline(&baseline, &[]);
        let white = [JointNoise::white(1.0 / 12.0); 2];
        let left = engine.refit(&alone, &engine.weights(&white), &[], Free::OfRecords, 0).expect("a fit");
        let weights = engine.weights(&engine.own_noise(&left, &white));
        let cost =
            |hypothesis: &Hypothesis| engine.refit(hypothesis, &weights, &[], Free::OfRecords, 0).expect("a fit").cost;
        cost(&alone) - cost(&held_out::adapted(&engine, &alone.with(contact(0.0)), &weights))
    };
    let of_noise: Vec<f64> = (0..12).map(|seed| gain(70 + seed)).collect();
    // Where as much is expected as of a push that moved what it was fitted to.
    let [anew, elsewhere] = [true, false].map(|searched| decide::least_kept(50.0, searched));
    assert!(of_noise.iter().all(|gain| *gain < anew), "{of_noise:?}, and {anew} asked for");
    assert!(of_noise.iter().any(|gain| *gain > elsewhere), "{of_noise:?}: {elsewhere} would do");
}

/// A recording kept back is louder than those fitted by chance, but not twice as loud.
#[test]
fn noise_of_what_was_kept_back_alone_is_expected_up_to_chance() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let truth = Hypothesis { base: baseline.values.of(&baseline.free), named: Vec::new() };
    let recorded = |torque_nm: f64, seed: u64| {
        let noise = NullNoise { torque_nm: [torque_nm; 2], ..NOISE };
        let movement: Trajectory = crate::trajectory_file::paper(4.3).expect("a period");
        simulated(&robot, &baseline, &truth, &movement, &noise, seed).expect("a recording")
    };
    let gap_and_floor = |quiet_nm: f64, loud_nm: f64| {
        let recordings = [recorded(quiet_nm, 60), recorded(loud_nm, 61)];
        let experiments = [0, 1].map(|of| Experiment::new(&robot, &recordings[of..=of]).expect("recordings"));
        let rows = experiments.each_ref().map(rows::Rows::new);
        let engine = |part: usize| {
            let setting = Setting { experiment: &experiments[part], rows: &rows[part], current_sigma_a: None };
            Engine::new(setting, &baseline)
        };
        let (train, check) = (engine(0), engine(1));
        let white = [JointNoise::white(1.0 / 12.0); 2];
        let fitted = train.refit(&truth, &train.weights(&white), &[], Free::All, 3).expect("a fit");
        let noise = train.own_noise(&fitted, &white);
        (check.gap(&check.innovations(&fitted.hypothesis)), held_out::kept_back_floor(&train, &fitted, &noise, &check))
    };
    let noise_nm = 0.005 * model.coulomb_nm[0];
    let (gap, floor) = gap_and_floor(noise_nm, noise_nm);
    assert!((gap / floor - 1.0).abs() < 0.2, "as loud: {gap} over {floor}");
    let (gap, floor) = gap_and_floor(noise_nm, 4.0 * noise_nm);
    assert!(gap > 1.5 * floor, "four times as loud: {gap} over {floor}");
}
