//! Robot files from answers, and the examples to begin with.

use armid::new_robot::{EXAMPLES, Interview};
use armid::robot::{Kind, Law, Robot, Unit};

fn example(name: &str) -> Robot {
    let text = EXAMPLES.iter().find(|(known, _, _)| *known == name).unwrap().2;
    Robot::from_bytes(name.as_ref(), text.into()).unwrap()
}

/// Answers every question by its key; what has no answer here takes its default.
fn answered(answers: &[(&str, &str)]) -> Interview {
    let mut interview = Interview::new();
    while let Some(question) = interview.question() {
        let answer = answers.iter().find(|(key, _)| *key == question.key).map_or("", |(_, answer)| answer);
        interview.answer(answer).unwrap_or_else(|error| panic!("{error}"));
    }
    interview
}

/// The double pendulum of the example, as its maker would describe it.
const PENDULUM: &[(&str, &str)] = &[
    ("name", "pendulum"),
    ("upper_arm_m", "0.35"),
    ("joint1.name", "shoulder"),
    ("joint1.gear_ratio", "1"),
    ("joint1.counts_per_rev", "65536"),
    ("joint1.torque_constant_nm_per_a", "2"),
    ("joint1.current_limit_a", "12"),
    ("joint1.viscous_friction_nm_s_per_rad", "0.02"),
    ("joint1.coulomb_friction_nm", "0.03"),
    ("joint1.position_low_rad", "-1.9"),
    ("joint1.position_high_rad", "0.4"),
    ("joint1.speed_limit_rad_s", "6"),
    ("joint1.acceleration_limit_rad_s2", "40"),
    ("joint2.name", "elbow"),
    ("joint2.gear_ratio", "1"),
    ("joint2.counts_per_rev", "65536"),
    ("joint2.torque_constant_nm_per_a", "0.5"),
    ("joint2.current_limit_a", "12"),
    ("joint2.viscous_friction_nm_s_per_rad", "0.005"),
    ("joint2.coulomb_friction_nm", "0.01"),
    ("joint2.position_low_rad", "-0.4"),
    ("joint2.position_high_rad", "2"),
    ("joint2.speed_limit_rad_s", "8"),
    ("joint2.acceleration_limit_rad_s2", "80"),
    ("link1.mass_kg", "3"),
    ("link1.centre_x_m", "0.18"),
    ("link1.centre_y_m", "0"),
    ("link1.inertia_kg_m2", "0.06"),
    ("link1.motor_inertia_kg_m2", "0.004"),
    ("link2.mass_kg", "1"),
    ("link2.centre_x_m", "0"),
    ("link2.centre_y_m", "-0.14"),
    ("link2.inertia_kg_m2", "0.012"),
    ("link2.motor_inertia_kg_m2", "0.001"),
];

#[test]
fn answers_become_a_robot_whose_expected_arm_is_that_of_the_guesses() {
    let (robot, text) = answered(PENDULUM).finish().unwrap();
    // By the definitions of f, as the example works them out.
    let expected = [0.0326, 0.0316, 0.0, -0.049, 0.0, -0.14, 0.3153, 0.0, 0.89];
    for (found, expected) in robot.expected_f().iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{:?}", robot.expected_f());
    }
    assert!(robot.search.iter().all(|[low, high]| low < high) && robot.search[6][0] > 0.0, "{:?}", robot.search);
    assert_eq!((robot.upper_arm_m, robot.joints[1].limits.speed_rad_s), (0.35, 8.0));
    // The paper's robot switches friction over 0.5 rad/s behind a gear of 53.7.
    let switch = robot.computed_torque.friction_switch_motor_rad_s;
    assert!((switch / (0.5 / 53.7) - 1.0).abs() < 0.05, "{switch}");
    // What is proposed is stable, with room to spare, and needs a lead: friction damps next to nothing.
    robot.check_gains().unwrap();
    let mut twice = robot.clone();
    for joint in &mut twice.joints {
        let Law::Proportional(position_loop) = &mut joint.law else { panic!("a cascade") };
        assert!(position_loop.lead > 1.0);
        position_loop.gain_a_per_count *= 1.5;
    }
    twice.check_gains().unwrap();
    // The file says the same, with remarks.
    assert_eq!(Robot::from_bytes("new.toml".as_ref(), text.clone().into_bytes()).unwrap(), robot);
    assert!(text.contains("# motor turns per joint turn"), "{text}");
}

#[test]
fn every_answer_is_checked_when_it_is_given() {
    for (key, wrong, limit) in [
        ("name", "", "a name for people"),
        ("kind", "three-link", "two-link or single-axis"),
        ("gravity_m_s2", "981", "below 100"),
        ("record_period_s", "0.7", "0.00001 to 0.1 s"),
        ("loop_period_s", "0.0005", "a whole fraction of record_period_s"),
        ("loop_period_s", "0.0001400", "0.00035"),
        ("record_period_s", "0.00033", "1 to 320 times one of the board's loop periods"),
        ("command_delay_s", "0.1", "below one loop period"),
        ("upper_arm_m", "-0.3", "0.001 to 100 m"),
        ("joint1.name", "a b", "letters, digits"),
        ("joint1.gear_ratio", "0", "other than 0"),
        ("joint1.counts_per_rev", "many", "a finite number"),
        ("joint2.counts_per_rev", "-1000", "above 0"),
        ("joint1.torque_constant_nm_per_a", "nan", "a finite number"),
        ("joint1.current_limit_a", "-12", "above 0"),
        ("joint1.current_full_scale_a", "0", "above 0"),
        ("joint1.current_full_scale_a", "12", "at least 12.632 A"),
        ("joint1.viscous_friction_nm_s_per_rad", "-1", "0 or above"),
        ("joint1.viscous_friction_nm_s_per_rad", "0", "at least 1e-9 N m s/rad"),
        ("joint2.coulomb_friction_nm", "60", "greatest torque"),
        ("joint1.position_high_rad", "-2", "above position_low_rad"),
        ("joint2.speed_limit_rad_s", "0", "above 0"),
        ("joint2.acceleration_limit_rad_s2", "-1", "above 0"),
        ("link2.mass_kg", "0", "above 0"),
        ("link1.inertia_kg_m2", "-1", "above 0"),
        ("joint1.lead", "21", "from 0 to 20"),
        ("joint2.position_gain_a_per_count", "10", "A/count; "),
    ] {
        let mut interview = Interview::new();
        let question = loop {
            let question = interview.question().unwrap_or_else(|| panic!("{key} is never asked"));
            if question.key == key {
                break question;
            }
            let answer = PENDULUM.iter().find(|(known, _)| *known == question.key).map_or("", |(_, answer)| answer);
            interview.answer(answer).unwrap();
        };
        let told = interview.answer(wrong).unwrap_err().to_string();
        assert!(told.contains(key) && told.contains(limit) && told.contains("; "), "{key} = {wrong}: {told}");
        assert_eq!(interview.question(), Some(question), "{key} is asked again");
    }
}

#[test]
fn the_loop_periods_named_are_accepted() {
    let mut interview = Interview::new();
    let mut at = |key: &str, answers: &[(&str, &str)]| {
        while let Some(question) = interview.question().filter(|question| question.key != key) {
            let answer = answers.iter().find(|(known, _)| *known == question.key).map_or("", |(_, answer)| answer);
            interview.answer(answer).unwrap();
        }
        interview.clone()
    };
    let interview = at("loop_period_s", &[("name", "arm"), ("record_period_s", "0.001")]);
    // The record period itself is none of the board's: the longest that divides it is proposed.
    assert_eq!(interview.question().unwrap().default.as_deref(), Some("0.0001"));
    let told = interview.clone().answer("0.00035").unwrap_err().to_string();
    assert!(told.contains("a whole fraction of record_period_s: 0.0001 or 0.00005 s"), "{told}");
    for named in ["0.0001", "0.00005"] {
        interview.clone().answer(named).unwrap();
    }
}

/// Gears and friction as the paper's robot has them: a loop that friction damps.
#[test]
fn where_friction_damps_no_lead_is_proposed() {
    let mut answers = PENDULUM.to_vec();
    for (key, answer) in [
        ("joint1.gear_ratio", "107.8"),
        ("joint1.counts_per_rev", "800"),
        ("joint1.torque_constant_nm_per_a", "0.25"),
        ("joint1.viscous_friction_nm_s_per_rad", "0.817e-3"),
        ("upper_arm_m", "0.4318"),
        ("link1.mass_kg", "17.4"),
        ("link1.inertia_kg_m2", "0.5"),
        ("link1.motor_inertia_kg_m2", "2e-4"),
        ("link2.mass_kg", "7.5"),
        ("link2.inertia_kg_m2", "0.4"),
    ] {
        answers.iter_mut().find(|(known, _)| *known == key).unwrap().1 = answer;
    }
    let (robot, _) = answered(&answers).finish().unwrap();
    let Law::Proportional(position_loop) = robot.joints[0].law else { panic!("a cascade") };
    // Half of Bv 2π / (N Td), the limit of a loop without a lead; Td is half a period and the delay.
    let limit_nm_per_count = 0.817e-3 * std::f64::consts::TAU / (800.0 * (0.00035 + 0.00003));
    let half_a_per_count = 0.5 * limit_nm_per_count / 0.25;
    assert_eq!(position_loop.lead, 0.0);
    let share = position_loop.gain_a_per_count / half_a_per_count;
    assert!(share > 0.9 && share <= 1.0, "{position_loop:?}");
}

#[test]
fn one_axis_is_asked_less() {
    let (robot, text) = answered(&[
        ("name", "slide"),
        ("kind", "single-axis"),
        ("unit", "m"),
        ("joint1.counts_per_rev", "1e6"),
        ("joint1.torque_constant_nm_per_a", "35"),
        ("joint1.current_limit_a", "10"),
        ("link1.moved", "95"),
        ("joint1.position_gain_a_per_count", "0.001"),
    ])
    .finish()
    .unwrap();
    assert_eq!((robot.kind, robot.unit, robot.joints.len()), (Kind::SingleAxis, Unit::Metre, 1));
    assert_eq!(robot.search[6], [47.5, 142.5]);
    assert!((robot.joints[0].counts_per_rad() - 1e6).abs() < 1e-3);
    // Nothing that an axis does not use, and nobody was asked for.
    for unused in ["position_low_rad", "speed_limit_rad_s", "[computed_torque]", "f1 =", "upper_arm_m"] {
        assert!(!text.contains(unused), "{unused} in {text}");
    }
    let read = Robot::from_bytes("slide.toml".as_ref(), text.into_bytes()).unwrap();
    assert_eq!(read, robot);
    assert_eq!((read.kind, read.unit), (Kind::SingleAxis, Unit::Metre));
}

#[test]
fn the_examples_are_what_they_say() {
    assert_eq!(example("puma-560"), Robot::paper());
    let emps = example("emps");
    assert_eq!(
        (emps.kind, emps.unit, emps.joints[0].torque_constant_nm_per_a),
        (Kind::SingleAxis, Unit::Metre, 35.1507)
    );
    // The board does not drive a single axis, and says so.
    let refused = armid::board_setup::configuration(&emps).unwrap_err().to_string();
    assert!(refused.contains("EMPS") && refused.contains("single axis"), "{refused}");
    let pendulum = example("direct-drive-double-pendulum");
    armid::board_setup::configuration(&pendulum).unwrap();
    let (from_answers, _) = answered(PENDULUM).finish().unwrap();
    for (found, expected) in pendulum.expected_f().iter().zip(from_answers.expected_f()) {
        assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
    }
}
