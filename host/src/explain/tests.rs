//! The whole way on simulated robots whose effect nobody told it.

use shared::trajectory::{Fourier, Harmonic, Trajectory};

use super::engine::Free;
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::library::kind;
use super::next::{next_trajectory, simulated};
use super::nulls::NullNoise;
use super::*;

mod noise_left;

const NOISE: NullNoise = NullNoise { torque_nm: [0.0; 2], correlation_time_s: [0.05; 2], position_counts: [0.0; 2] };

/// A baseline as `identify` leaves it: near the truth by its standard errors.
fn model(robot: &Robot) -> Model {
    let mut model = crate::hidden_robot::HiddenRobot::draw(robot, 5).to_model(toml::Table::new());
    let baseline = toml::Value::Array(vec!["baseline.csv".into()]);
    model.provenance.insert("recordings".into(), baseline);
    model.f_standard_error = Some([0.003, 0.003, 0.003, 0.003, 0.003, 0.003, 0.012, 0.004, 0.006]);
    model.viscous_standard_error = Some(model.viscous_nm_s_per_rad.iter().map(|v| 0.005 * v).collect());
    model.coulomb_standard_error = Some(model.coulomb_nm.iter().map(|c| 0.003 * c).collect());
    model
}

fn recordings(robot: &Robot, baseline: &Baseline, effects: Vec<Instance>) -> Vec<Recording> {
    recordings_over([3.65, 5.0, 4.3], robot, baseline, effects)
}

fn recordings_over(periods_s: [f64; 3], robot: &Robot, baseline: &Baseline, effects: Vec<Instance>) -> Vec<Recording> {
    let truth = Hypothesis { base: baseline.values.of(&baseline.free), named: effects };
    periods_s
        .into_iter()
        .enumerate()
        .map(|(index, period_s)| {
            let movement: Trajectory = crate::trajectory_file::paper(period_s).expect("a period");
            simulated(robot, baseline, &truth, &movement, &NOISE, 40 + index as u64).expect("a recording")
        })
        .collect()
}

fn explained(effects: &[(&str, usize, &[f64])]) -> Explanation {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let effect = |(name, joint, values): &(&str, usize, &[f64])| {
        Instance::new(kind(name).or_else(|| strangers::kind_of(name)).expect("an effect"), *joint, values, 1)
    };
    let recordings = recordings(&robot, &baseline, effects.iter().map(effect).collect());
    let (fitted, check) = recordings.split_at(2);
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    explain(&robot, fitted, check, Some(&model), &options, &|_| ()).expect("an explanation")
}

#[test]
fn a_robot_that_lacks_nothing_gets_no_name() {
    let explanation = explained(&[]);
    assert_eq!(explanation.verdict, Verdict::None, "{:?}", explanation.sentences);
    assert!(explanation.effects.is_empty());
}

#[test]
fn a_hidden_effect_is_named_and_closes_the_gap() {
    let explanation = explained(&[("asymmetric-viscous-friction", 1, &[3e-4])]);
    assert_eq!(explanation.verdict, Verdict::Named, "{:?}", explanation.sentences);
    let [finding] = &explanation.effects[..] else { panic!("{:?}", explanation.effects) };
    assert_eq!((finding.name, finding.joint.as_str()), ("asymmetric-viscous-friction", "3"));
    let found = &finding.parameters["difference_nm_s_per_rad"];
    assert!((found.value / 3e-4 - 1.0).abs() < 0.03, "{found:?}");
    let held_out = explanation.gap.held_out.expect("a recording was kept back");
    assert!(held_out.before > 3.0 * explanation.gap.floor && held_out.after < 1.05 * explanation.gap.floor);
    let json = explanation.to_json();
    assert_eq!(json["recordings_exchanged"], false);
    assert_eq!(json["effects"][0]["class"][0], "asymmetric-viscous-friction");
    // The model says which recordings it was fitted to now, and keeps those of the baseline apart.
    let listed = |key: &str| explanation.model.provenance[key].as_array().map_or(0, Vec::len);
    assert_eq!((listed("recordings"), listed("baseline_recordings")), (2, 1), "{:?}", explanation.model.provenance);
    let [findings, named] = &explanation.sections()[..2] else { panic!("no sections") };
    assert_eq!([findings.title.as_str(), named.title.as_str()], ["Findings", "Effects named"]);
    assert!(!explanation.pictures.is_empty());
}

/// A slow encoder jumps by a count at every edge; a count that is lost does not come back.
#[test]
fn a_single_lost_count_is_found() {
    let explanation = explained(&[("count-loss", 1, &[-1.0, 1.3])]);
    let [finding] = &explanation.effects[..] else { panic!("{:?}", explanation.sentences) };
    assert_eq!((finding.name, finding.joint.as_str()), ("count-loss", "3"));
    assert!((finding.parameters["instant_s_1"].value - 1.3).abs() < 2e-3, "{:?}", finding.parameters);
}

/// While the torque constant is wrong, a push is found where that shows most, and each instant holds the others where they are.
#[test]
fn a_contact_is_found_beside_another_effect() {
    let effects: [(&str, usize, &[f64]); 2] =
        [("torque-constant", 1, &[-0.04]), ("external-contact", 1, &[-2.6, 0.45, 2.2])];
    let explanation = explained(&effects);
    let mut found: Vec<_> = explanation.effects.iter().map(|effect| (effect.name, effect.joint.as_str())).collect();
    found.sort_unstable();
    assert_eq!(explanation.verdict, Verdict::Named, "{:?}", explanation.sentences);
    assert_eq!(found, [("external-contact", "3"), ("torque-constant", "3")], "{:?}", explanation.sentences);
    let contact = explanation.effects.iter().find(|effect| effect.name == "external-contact").expect("a contact");
    let value = |name: &str| contact.parameters[name].value;
    assert!((value("torque_nm") / -2.6 - 1.0).abs() < 0.05, "{:?}", contact.parameters);
    assert!((value("duration_s") - 0.45).abs() < 0.01, "{:?}", contact.parameters);
    for start in ["start_s_1", "start_s_2"] {
        assert!((value(start) - 2.2).abs() < 0.01, "{:?}", contact.parameters);
    }
}

/// Crosstalk adds torque, as another torque constant does; a spring with slack is a spring.
#[test]
fn what_only_resembles_an_effect_is_not_given_its_name() {
    let strangers: [(&str, usize, &[f64]); 2] = [("crosstalk", 1, &[0.04]), ("slack-spring", 0, &[12.0, -0.8, 0.35])];
    for stranger in strangers {
        let explanation = explained(&[stranger]);
        assert_eq!(explanation.verdict, Verdict::Unknown, "{stranger:?}: {:?}", explanation.sentences);
    }
    // The effects themselves keep their names.
    let effects: [(&str, usize, &[f64]); 2] = [("torque-constant", 1, &[0.03]), ("gravity-spring", 0, &[3.0, 0.4])];
    for effect in effects {
        let explanation = explained(&[effect]);
        let [finding] = &explanation.effects[..] else { panic!("{effect:?}: {:?}", explanation.sentences) };
        assert_eq!((explanation.verdict, finding.name), (Verdict::Named, effect.0), "{:?}", explanation.sentences);
    }
}

/// How a joint's inertia is shared between motor and link nobody knows beforehand. A share that is wrong leaves gaps of
/// several times the floor, and a count that seems lost beside play.
#[test]
fn the_motors_inertia_is_found_with_flexibility_and_play() {
    let effects: [(&str, usize, &[f64]); 2] =
        [("joint-flexibility", 0, &[2.5e-5, 6e-4, 3.1e-4]), ("backlash", 0, &[1.2e-3, 2.4e-4])];
    for (name, joint, values) in effects {
        let explanation = explained(&[(name, joint, values)]);
        let [finding] = &explanation.effects[..] else { panic!("{name}: {:?}", explanation.sentences) };
        assert_eq!((explanation.verdict, finding.name), (Verdict::Named, name), "{:?}", explanation.sentences);
        let found = finding.parameters["motor_inertia_kg_m2"].value / values.last().expect("values");
        assert!((found - 1.0).abs() < 0.05, "{name}: {:?}", finding.parameters);
        let held_out = explanation.gap.held_out.expect("a recording was kept back");
        assert!(held_out.after < 1.05 * explanation.gap.floor, "{name}: {:?}", explanation.gap);
    }
}

#[test]
fn two_hidden_effects_are_both_named() {
    let explanation = explained(&[("torque-offset", 0, &[0.03]), ("cogging", 1, &[0.02, 0.7, 3.3])]);
    assert_eq!(explanation.verdict, Verdict::Named, "{:?}", explanation.sentences);
    let mut found: Vec<_> =
        explanation.effects.iter().map(|effect| (effect.joint.as_str(), effect.class.as_slice())).collect();
    found.sort_unstable();
    let [("2", offset), ("3", ["cogging"])] = found[..] else { panic!("{found:?}") };
    assert!(offset.contains(&"torque-offset"), "{offset:?}");
    assert!(explanation.gap.after < 1.05 * explanation.gap.floor, "{:?}", explanation.gap);
}

/// A gear transmits what the motor's inertia does not take, and how much that is nobody knows beforehand: a share that is
/// wrong left what a spring or a gap took.
#[test]
fn friction_that_grows_with_the_load_comes_with_the_motors_inertia() {
    let explanation = explained(&[("load-dependent-friction", 1, &[0.08, 3e-4])]);
    let [finding] = &explanation.effects[..] else { panic!("{:?}", explanation.sentences) };
    assert_eq!((explanation.verdict, finding.name), (Verdict::Named, "load-dependent-friction"));
    let found = |name: &str| finding.parameters[name].value;
    assert!((found("coefficient") / 0.08 - 1.0).abs() < 0.03, "{:?}", finding.parameters);
    assert!((found("motor_inertia_kg_m2") / 3e-4 - 1.0).abs() < 0.1, "{:?}", finding.parameters);
}

/// The plant leaves every motor some inertia: a refit that tried less finds back.
#[test]
fn a_motors_inertia_below_the_least_is_found_again() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let load = |coefficient: f64, inertia: f64, records: usize| {
        Instance::new(kind("load-dependent-friction").expect("an effect"), 1, &[coefficient, inertia], records)
    };
    let recordings = recordings(&robot, &baseline, vec![load(0.08, 3e-4, 1)]);
    let experiment = Experiment::new(&robot, &recordings).expect("recordings");
    let rows = rows::Rows::new(&experiment);
    let engine = Engine::new(Setting { experiment: &experiment, rows: &rows, current_sigma_a: None }, &baseline);
    let start = Hypothesis::baseline(&baseline, &[load(0.06, 1e-7, 3)]);
    let weights = engine.weights(&[noise::JointNoise::white(1.0 / 12.0); 2]);
    let fitted = engine.refit(&start, &weights, &[], Free::All, 10).expect("a fit");
    let [coefficient, inertia] = [0, 1].map(|of| fitted.hypothesis.named[0].common[of].expect("a value"));
    assert!((coefficient / 0.08 - 1.0).abs() < 0.03 && (inertia / 3e-4 - 1.0).abs() < 0.05, "{coefficient} {inertia}");
}

/// While the spring is unknown, base parameters bend to imitate it: beside the other effect it is found from where they were.
#[test]
fn an_effect_that_base_parameters_imitate_is_named_beside_another() {
    let explanation = explained(&[("back-emf", 1, &[1.8e-3]), ("gravity-spring", 0, &[2.4, -3.1])]);
    assert_eq!(explanation.verdict, Verdict::Named, "{:?}", explanation.sentences);
    let mut found: Vec<_> =
        explanation.effects.iter().map(|effect| (effect.joint.as_str(), effect.class.as_slice())).collect();
    found.sort_unstable();
    let [("2", ["gravity-spring"]), ("3", lost)] = found[..] else { panic!("{found:?}") };
    assert!(lost.contains(&"back-emf"), "{lost:?}");
}

#[test]
fn recordings_of_two_robots_are_told_apart_and_nothing_named() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let mut other = baseline.clone();
    other.values.f[6] *= 1.06;
    other.values.f[8] *= 0.95;
    other.values.coulomb_nm[0] *= 1.1;
    let one = recordings(&robot, &baseline, Vec::new());
    let two = recordings(&robot, &other, Vec::new());
    let mixed = [one[0].clone(), two[1].clone()];
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    for (fitted, check) in [(&mixed[..], &one[2..]), (&one[..2], &two[2..])] {
        let explanation = explain(&robot, fitted, check, Some(&model), &options, &|_| ()).expect("an explanation");
        assert_eq!(explanation.verdict, Verdict::Unknown, "{:?}", explanation.sentences);
        assert!(explanation.effects.is_empty() && explanation.recordings_disagree, "{:?}", explanation.sentences);
    }
}

#[test]
fn a_wrong_gain_is_told_and_nothing_named() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let recordings = recordings(&robot, &baseline, Vec::new());
    let mut other = robot.clone();
    other.joints[1].law =
        crate::robot::Law::Proportional(shared::control::PositionLoop { gain_a_per_count: 0.04, lead: 0.0 });
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    let refused = explain(&other, &recordings, &[], Some(&model), &options, &|_| ());
    assert!(matches!(refused, Err(ExplainError::Audit(AuditError::WrongGain { .. }))), "{refused:?}");
}

/// Only the fastest movement, which is kept back, asks for more current than there is.
#[test]
fn what_only_the_recording_kept_back_shows_is_named() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let limit = Instance::new(kind("current-saturation").expect("an effect"), 1, &[4.0], 1);
    let mut recordings = recordings_over([6.0, 5.0, 3.65], &robot, &baseline, vec![limit]);
    for recording in &mut recordings {
        // The simulation shows what was asked for, a sensor what flows.
        recording.current_a[1].iter_mut().for_each(|current_a| *current_a = current_a.clamp(-4.0, 4.0));
    }
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    let (fitted, check) = recordings.split_at(2);
    let explanation = explain(&robot, fitted, check, Some(&model), &options, &|_| ()).expect("an explanation");
    let [finding] = &explanation.effects[..] else { panic!("{:?}", explanation.sentences) };
    assert_eq!((finding.name, finding.joint.as_str()), ("current-saturation", "3"));
    assert!((finding.parameters["limit_a"].value - 4.0).abs() < 0.01, "{:?}", finding.parameters);
    assert!(explanation.recordings_exchanged, "{:?}", explanation.sentences);
}

/// A movement that shows little: one joint swings a little, the other hardly.
fn poor(centre_rad: [f32; 2], amplitude_rad: [f32; 2]) -> Trajectory {
    let harmonic = Harmonic { cosine_rad: [amplitude_rad[0], 0.0], sine_rad: [0.0, amplitude_rad[1]] };
    Trajectory::Fourier(Fourier {
        period_ns: 4_000_000_000,
        repeats: 1,
        fade_ns: 800_000_000,
        centre_rad,
        harmonics: std::iter::once(harmonic).collect(),
    })
}

#[test]
fn the_next_movement_tells_apart_what_a_poor_one_does_not() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let noise = NullNoise { torque_nm: [1.4e-3; 2], ..NOISE };
    let swinging = [[0.03, 0.15], [0.1, 0.03], [0.006, 0.03]];
    let swinging = [0, 1, 2].map(|of| poor(if of == 0 { [0.0, -1.2] } else { [-1.2, 0.0] }, swinging[of]));
    type Member = (&'static str, usize, &'static [f64]);
    let pairs: [(Member, Member, &Trajectory); 4] = [
        (("torque-constant", 1, &[0.006]), ("payload", 0, &[0.03, 0.0, -0.4]), &swinging[0]),
        (("torque-ripple", 0, &[0.02, 0.3, 2.7]), ("transmission-error", 0, &[2e-5, 0.3, 2.7]), &swinging[2]),
        (("backlash", 1, &[8e-4]), ("joint-flexibility", 1, &[1e-5, 4e-4]), &swinging[0]),
        (("base-tilt", 0, &[0.01]), ("torque-offset", 0, &[0.005]), &swinging[1]),
    ];
    for ((name, joint, values), other, movement) in pairs {
        let with = |(name, joint, values): Member| Hypothesis {
            base: baseline.values.of(&baseline.free),
            named: vec![Instance::new(kind(name).expect("an effect"), joint, values, 1)],
        };
        let (truth, wrong) = (with((name, joint, values)), with(other));
        let recorded = |movement: &Trajectory, seed: u64| {
            simulated(&robot, &baseline, &truth, movement, &noise, seed).expect("a recording")
        };
        let told = |recordings: &[Recording]| {
            let options = Options { seed: 1, design_next: false, kept_thresholds: None };
            let explanation =
                explain(&robot, recordings, &[], Some(&model), &options, &|_| ()).expect("an explanation");
            explanation.effects.iter().map(|effect| effect.class.clone()).collect::<Vec<_>>()
        };
        let first = recorded(movement, 3);
        assert_ne!(told(std::slice::from_ref(&first)), [[name]], "{name}: the poor movement is not poor");

        let of_robot = [noise::JointNoise::white(1.0 / 12.0); 2];
        let next = next_trajectory(&robot, &baseline, [&truth, &wrong], &of_robot, 1).expect("a movement");
        let path = std::env::temp_dir().join(format!("armid-next-{}-{name}.toml", std::process::id()));
        std::fs::write(&path, &next.toml).expect("a file");
        let designed = crate::trajectory_file::read(&path).expect("a movement");
        std::fs::remove_file(&path).expect("the file");
        assert_eq!(told(&[first, recorded(&designed, 9)]), [[name]], "{name}");
    }
}

/// What was kept of an experiment is found again and changes nothing; what belongs to another is not taken for it.
#[test]
fn thresholds_are_kept_by_experiment() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let recordings = recordings(&robot, &baseline, Vec::new());
    let folder = tempfile::tempdir().expect("a folder");
    let kept = || std::fs::read_dir(folder.path()).expect("a folder").flatten().map(|file| file.path());
    let explained = |seed: u64| {
        let options = Options { seed, design_next: false, kept_thresholds: Some(folder.path().into()) };
        let (fitted, check) = recordings.split_at(1);
        explain(&robot, fitted, &check[..1], Some(&model), &options, &|_| ()).expect("an explanation")
    };
    let first = explained(1);
    let path = kept().next().expect("scores were kept");
    assert_eq!(explained(1).to_json(), first.to_json());
    assert_eq!(kept().count(), 1);

    // That they were read shows when they say something else.
    let text = std::fs::read_to_string(&path).expect("scores");
    let lines = text.lines().count();
    std::fs::write(&path, "1000\n".repeat(lines)).expect("written");
    assert_eq!(explained(1).threshold[0], 1000.0);
    assert_ne!(explained(2).threshold[0], 1000.0);
    assert_eq!(kept().count(), 2);

    // Half a file is none.
    std::fs::write(&path, "1000\n").expect("written");
    assert_eq!(explained(1).threshold, first.threshold);
}

/// An encoder of which one edge in four is counted.
#[test]
fn an_encoder_that_leaves_counts_out_is_told_and_nothing_named() {
    let robot = Robot::paper();
    let model = model(&robot);
    let baseline = baseline(&robot, &model, true);
    let mut recordings = recordings(&robot, &baseline, Vec::new());
    for recording in &mut recordings {
        let rows = recording.reference_counts[1].iter().zip(&mut recording.error_counts[1]);
        rows.for_each(|(reference, error)| *error = reference - 4.0 * ((reference - *error) / 4.0).trunc());
    }
    // The law acted on what the coarse encoder showed.
    let crate::robot::Law::Proportional(law) = robot.joints[1].law else { panic!("a position loop") };
    for recording in &mut recordings {
        if let Some(command) = &mut recording.command_a {
            command[1] = recording.error_counts[1].iter().map(|error| law.gain_a_per_count * error).collect();
        }
    }
    let (fitted, check) = recordings.split_at(2);
    let options = Options { seed: 1, design_next: false, kept_thresholds: None };
    let explanation = explain(&robot, fitted, check, Some(&model), &options, &|_| ()).expect("an explanation");
    assert_eq!((explanation.verdict, explanation.effects.len()), (Verdict::Unknown, 0));
    assert!(explanation.sentences.iter().any(|s| s.contains("steps of 4 counts")), "{:?}", explanation.sentences);
}
