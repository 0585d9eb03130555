//! The questions, in their order.

use shared::control::PositionLoop;

use super::{Draft, proposal};
use crate::board_setup::loop_periods_s;
use crate::links::Link;
use crate::robot::{JointLimits, Kind, Law, Robot, Unit};

/// Where an answer goes.
#[derive(Clone, Copy)]
pub(super) enum Put {
    /// A word; an error says what it must be.
    Text(fn(&mut Draft, usize, &str) -> Result<(), &'static str>),
    /// A number that the robot file's own checks judge.
    Number(fn(&mut Draft, usize, f64)),
    /// A number above 0 that is no value of the robot file.
    Positive(fn(&mut Draft, usize, f64)),
}

/// One question.
pub(super) struct Step {
    /// `joint` or `link`, or nothing.
    pub of: &'static str,
    /// Which joint or link.
    pub index: usize,
    /// Key of the robot file, or of a link.
    pub field: &'static str,
    pub text: &'static str,
    pub unit: &'static str,
    pub default: fn(&Draft, usize) -> Option<String>,
    pub put: Put,
}

impl Step {
    /// Name of the answer.
    pub fn key(&self) -> String {
        if self.of.is_empty() { self.field.into() } else { format!("{}{}.{}", self.of, self.index + 1, self.field) }
    }

    /// Name of the joint that the answer is about, once it was asked for.
    fn joint_name<'a>(&self, draft: &'a Draft) -> Option<&'a str> {
        let is_named = !self.of.is_empty() && self.field != "name";
        draft.robot.joints.get(self.index).filter(|_| is_named).map(|joint| joint.name.as_str())
    }

    /// Name of the answer by the joint's own name.
    pub fn named_key(&self, draft: &Draft) -> Option<String> {
        self.joint_name(draft).map(|name| format!("{}_{name}.{}", self.of, self.field))
    }

    /// Which joint or link is asked about.
    pub fn whose(&self, draft: &Draft) -> String {
        match (self.of, self.joint_name(draft)) {
            ("", _) => String::new(),
            ("link", Some(name)) => format!("link of joint {name}"),
            (_, Some(name)) => format!("joint {name}"),
            (_, None) => format!("joint no. {}", self.index + 1),
        }
    }

    /// The joint, if it is a joint's value.
    pub fn joint(&self) -> Option<usize> {
        (self.of == "joint").then_some(self.index)
    }
}

fn none(_: &Draft, _: usize) -> Option<String> {
    None
}

fn shown(value: f64) -> Option<String> {
    Some(value.to_string())
}

/// Every question for a robot of this kind.
pub(super) fn steps(robot: &Robot) -> Vec<Step> {
    let step = |field, text, unit, default, put| Step { of: "", index: 0, field, text, unit, default, put };
    let mut steps = vec![
        step("name", "What is the robot called?", "", none as fn(&Draft, usize) -> Option<String>, Put::Text(put_name)),
        step(
            "kind",
            "Two links in a vertical plane, or one axis? (two-link, single-axis)",
            "",
            |_, _| Some("two-link".into()),
            Put::Text(put_kind),
        ),
    ];
    if robot.kind == Kind::SingleAxis {
        let text = "Does it turn (rad) or slide (m)?";
        steps.push(step("unit", text, "", |_, _| Some("rad".into()), Put::Text(put_unit)));
    } else {
        steps.push(step(
            "gravity_m_s2",
            "Gravity in the arm's plane",
            "m/s²",
            |_, _| Some("9.81".into()),
            Put::Number(|draft, _, value| draft.robot.gravity_m_s2 = value),
        ));
    }
    steps.extend([
        step(
            "record_period_s",
            "Time between two recorded samples",
            "s",
            |_, _| Some("0.0007".into()),
            Put::Number(|draft, _, value| {
                draft.robot.record_period_s = value;
                draft.robot.loop_period_s = value;
                draft.robot.command_delay_s = 0.0;
            }),
        ),
        step(
            "loop_period_s",
            "Time between two ticks of the position loop",
            "s",
            |draft, _| {
                let robot = &draft.robot;
                let boards =
                    if robot.kind == Kind::TwoLink { loop_periods_s(robot.record_period_s) } else { Vec::new() };
                shown(boards.first().copied().unwrap_or(robot.record_period_s))
            },
            Put::Number(|draft, _, value| draft.robot.loop_period_s = value),
        ),
        step(
            "command_delay_s",
            "From reading the encoders to the new current",
            "s",
            |draft, _| shown(0.00003_f64.min(0.5 * draft.robot.loop_period_s)),
            Put::Number(|draft, _, value| draft.robot.command_delay_s = value),
        ),
    ]);
    if robot.kind == Kind::TwoLink {
        steps.push(step(
            "upper_arm_m",
            "Length of the upper arm, from joint to joint",
            "m",
            none,
            Put::Number(|draft, _, value| draft.robot.upper_arm_m = value),
        ));
    }
    for index in 0..robot.joints.len() {
        steps.extend(of_joint(index, robot));
    }
    for index in 0..robot.joints.len() {
        steps.extend(of_link(index, robot));
    }
    for index in 0..robot.joints.len() {
        steps.extend(of_loop(index));
    }
    steps
}

fn of_joint(index: usize, robot: &Robot) -> Vec<Step> {
    let number = |field, text, unit, default: fn(&Draft, usize) -> Option<String>, put: fn(&mut Draft, usize, f64)| {
        Step { of: "joint", index, field, text, unit, default, put: Put::Number(put) }
    };
    let mut steps = vec![Step {
        of: "joint",
        index,
        field: "name",
        text: "What is the joint called? It ends its columns in a recording",
        unit: "",
        default: |draft, index| {
            Some(if draft.robot.kind == Kind::TwoLink { (index + 2).to_string() } else { "1".into() })
        },
        put: Put::Text(|draft, index, answer| {
            draft.robot.joints[index].name = answer.into();
            Ok(())
        }),
    }];
    let slides = robot.unit == Unit::Metre;
    if slides {
        steps.push(number(
            "counts_per_rev",
            "Encoder counts per metre, quadrature included",
            "1/m",
            none,
            |draft, index, value| {
                draft.robot.joints[index].counts_per_rev = std::f64::consts::TAU * value;
            },
        ));
    } else {
        steps.extend([
            number(
                "gear_ratio",
                "Motor turns per joint turn; negative where the motor turns the other way, 1 without a gear",
                "",
                none,
                |draft, index, value| draft.robot.joints[index].gear_ratio = value,
            ),
            number(
                "counts_per_rev",
                "Encoder counts per motor turn, quadrature included",
                "",
                none,
                |draft, index, value| {
                    draft.robot.joints[index].counts_per_rev = value;
                },
            ),
        ]);
    }
    let [constant, constant_unit, limit, limit_unit] = if slides {
        ["Force per unit of the drive's command", "N per unit", "Greatest command of the drive", "its unit"]
    } else {
        ["Motor torque per ampere", "N m/A", "Greatest current of the amplifier", "A"]
    };
    steps.extend([
        number("torque_constant_nm_per_a", constant, constant_unit, none, |draft, index, value| {
            draft.robot.joints[index].torque_constant_nm_per_a = value;
        }),
        number("current_limit_a", limit, limit_unit, none, |draft, index, value| {
            let joint = &mut draft.robot.joints[index];
            joint.current_limit_a = value;
            joint.current_full_scale_a = 1.25 * value;
        }),
    ]);
    if slides {
        return steps;
    }
    steps.extend([
        number(
            "current_full_scale_a",
            "Current at full scale of the board's converters",
            "A",
            |draft, index| shown(draft.robot.joints[index].current_full_scale_a),
            |draft, index, value| draft.robot.joints[index].current_full_scale_a = value,
        ),
        number(
            "viscous_friction_nm_s_per_rad",
            "Viscous friction at the motor, rather too small than too large: the loop's stability rests on it",
            "N m s/rad",
            none,
            |draft, index, value| draft.robot.joints[index].viscous_friction_nm_s_per_rad = Some(value),
        ),
        number(
            "coulomb_friction_nm",
            "Coulomb friction at the motor; 0 where it is not known",
            "N m",
            |_, _| Some("0".into()),
            |draft, index, value| draft.robot.joints[index].coulomb_friction_nm = Some(value),
        ),
        number("position_low_rad", "Least angle of the joint", "rad", none, |draft, index, value| {
            let limits = &mut draft.robot.joints[index].limits;
            limits.position_low_rad = value;
            limits.position_high_rad = limits.position_high_rad.max(value + 1.0);
        }),
        number("position_high_rad", "Greatest angle of the joint", "rad", none, |draft, index, value| {
            draft.robot.joints[index].limits.position_high_rad = value;
        }),
        number("speed_limit_rad_s", "Greatest speed of the joint", "rad/s", none, |draft, index, value| {
            draft.robot.joints[index].limits.speed_rad_s = value;
        }),
        number(
            "acceleration_limit_rad_s2",
            "Greatest acceleration of the joint",
            "rad/s²",
            none,
            |draft, index, value| {
                draft.robot.joints[index].limits.acceleration_rad_s2 = value;
            },
        ),
    ]);
    steps
}

fn of_link(index: usize, robot: &Robot) -> Vec<Step> {
    let step = |field, text, unit, put| Step { of: "link", index, field, text, unit, default: none, put };
    let positive = |field, text, unit, put: fn(&mut Draft, usize, f64)| step(field, text, unit, Put::Positive(put));
    if robot.kind == Kind::SingleAxis {
        let unit = if robot.unit == Unit::Metre { "kg" } else { "kg m²" };
        let text = "About how much moves, the motor's share as the load feels it included";
        return vec![positive("moved", text, unit, |draft, _, value| {
            draft.robot.search[6] = [proposal::GUESS_LOW * value, proposal::GUESS_HIGH * value];
        })];
    }
    // Link 1 is the one behind joint 1.
    let centre = |axis: usize| -> Step {
        let (field, text): (_, &'static str) = if axis == 0 {
            ("centre_x_m", "About where is its centre of mass, along its x axis")
        } else {
            ("centre_y_m", "And along its y axis (y points down where x is level and points away)")
        };
        let put: fn(&mut Draft, usize, f64) = if axis == 0 {
            |draft, index, value| change(draft, index, |link| link.centre_m[0] = value)
        } else {
            |draft, index, value| change(draft, index, |link| link.centre_m[1] = value)
        };
        step(field, text, "m", Put::Number(put))
    };
    vec![
        positive("mass_kg", "About how heavy is the link, with what it carries", "kg", |draft, index, value| {
            change(draft, index, |link| link.mass_kg = value);
        }),
        centre(0),
        centre(1),
        positive(
            "inertia_kg_m2",
            "About which inertia has it about its centre of mass",
            "kg m²",
            |draft, index, value| {
                change(draft, index, |link| link.inertia_kg_m2 = value);
            },
        ),
        positive(
            "motor_inertia_kg_m2",
            "About which inertia has its motor's rotor",
            "kg m²",
            |draft, index, value| {
                change(draft, index, |link| link.motor_inertia_kg_m2 = value);
            },
        ),
    ]
}

/// Changes a link, and the search ranges with it.
fn change(draft: &mut Draft, index: usize, change: impl Fn(&mut Link)) {
    change(&mut draft.links[index]);
    draft.robot.search = proposal::search(&draft.robot, &draft.links);
}

fn of_loop(index: usize) -> Vec<Step> {
    let lead = |draft: &Draft, index: usize| shown(proposal::position_loop(&draft.robot, index).lead);
    // Where nothing is known of the friction, no gain can be proposed.
    let gain = |draft: &Draft, index: usize| {
        Some(proposal::gain_a_per_count(&draft.robot, index)).filter(|gain| *gain > 0.0).and_then(shown)
    };
    let of = "joint";
    vec![
        Step {
            of,
            index,
            field: "lead",
            text: "Lead of the position loop, in ticks; more damps more, and amplifies the encoder's rounding",
            unit: "ticks",
            default: lead,
            put: Put::Number(|draft, index, value| {
                // The gain is asked next; until then it is one that the lead allows.
                put_loop(&mut draft.robot, index, |position_loop| position_loop.lead = value);
                let gain = proposal::gain_a_per_count(&draft.robot, index);
                put_loop(&mut draft.robot, index, |position_loop| position_loop.gain_a_per_count = gain);
            }),
        },
        Step {
            of,
            index,
            field: "position_gain_a_per_count",
            text: "Gain of the position loop (the default leaves half of the stability limit)",
            unit: "A/count",
            default: gain,
            put: Put::Number(|draft, index, value| {
                put_loop(&mut draft.robot, index, |position_loop| position_loop.gain_a_per_count = value);
            }),
        },
    ]
}

fn put_loop(robot: &mut Robot, index: usize, change: impl Fn(&mut PositionLoop<f64>)) {
    if let Law::Proportional(position_loop) = &mut robot.joints[index].law {
        change(position_loop);
    }
}

fn put_name(draft: &mut Draft, _: usize, answer: &str) -> Result<(), &'static str> {
    if answer.is_empty() {
        return Err("a name for people");
    }
    draft.robot.name = answer.into();
    Ok(())
}

fn put_kind(draft: &mut Draft, _: usize, answer: &str) -> Result<(), &'static str> {
    match answer {
        "two-link" => draft.robot.kind = Kind::TwoLink,
        "single-axis" => {
            draft.robot.kind = Kind::SingleAxis;
            draft.robot.gravity_m_s2 = 0.0;
            draft.robot.joints.truncate(1);
        }
        _ => return Err("two-link or single-axis"),
    }
    Ok(())
}

fn put_unit(draft: &mut Draft, _: usize, answer: &str) -> Result<(), &'static str> {
    match answer {
        "rad" => draft.robot.unit = Unit::Radian,
        "m" => {
            draft.robot.unit = Unit::Metre;
            for (index, joint) in draft.robot.joints.iter_mut().enumerate() {
                joint.limits = JointLimits::not_given(index, Unit::Metre);
                joint.viscous_friction_nm_s_per_rad = None;
                joint.coulomb_friction_nm = None;
            }
        }
        _ => return Err("rad or m"),
    }
    Ok(())
}
