//! The robot file's TOML, as it is read: keys and defaults.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use serde::Deserialize;
use shared::arm::{PUMA_UPPER_ARM_M, REFERENCE_F};
use shared::control::{ComputedTorqueSettings, PositionLoop};
use toml::Spanned;

use super::{DEFAULT_FULL_SCALE_A, Gripper, Joint, JointLimits, Kind, Law, Robot, Unit, default_search};
use crate::file_error::{FileError, Problem};
use crate::toml_text::TomlText;

type Number = Option<Spanned<f64>>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawRobot {
    name: String,
    #[serde(default)]
    kind: RawKind,
    #[serde(default)]
    unit: RawUnit,
    gravity_m_s2: Number,
    record_period_s: Spanned<f64>,
    loop_period_s: Number,
    command_delay_s: Number,
    counts_per_tick_limit: Number,
    upper_arm_m: Number,
    following_error_limit_counts: Number,
    #[serde(default = "yes")]
    quantised: bool,
    #[serde(default)]
    current_is_command: bool,
    joint: Vec<RawJoint>,
    gripper: Option<RawGripper>,
    #[serde(default)]
    computed_torque: RawComputedTorque,
    #[serde(default)]
    search: BTreeMap<Spanned<String>, Spanned<[f64; 2]>>,
}

fn yes() -> bool {
    true
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum RawKind {
    #[default]
    TwoLink,
    SingleAxis,
}

#[derive(Clone, Copy, Default, PartialEq, Deserialize)]
enum RawUnit {
    #[default]
    #[serde(rename = "rad")]
    Radian,
    #[serde(rename = "m")]
    Metre,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum RawLaw {
    #[default]
    Proportional,
    Cascade,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawJoint {
    name: Spanned<String>,
    gear_ratio: Number,
    counts_per_rev: Number,
    counts_per_unit: Number,
    torque_constant_nm_per_a: Number,
    actuator_gain: Number,
    current_limit_a: Number,
    command_limit: Number,
    #[serde(default)]
    law: RawLaw,
    position_gain_a_per_count: Number,
    lead: Number,
    position_gain_per_s: Number,
    velocity_gain: Number,
    viscous_friction_nm_s_per_rad: Number,
    coulomb_friction_nm: Number,
    current_full_scale_a: Number,
    position_low_rad: Number,
    position_high_rad: Number,
    speed_limit_rad_s: Number,
    acceleration_limit_rad_s2: Number,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawGripper {
    maximum_load_kg: Spanned<f64>,
    grasp_m: Spanned<[f64; 2]>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawComputedTorque {
    bandwidth_rad_s: Number,
    damping_ratio: Number,
    observer_bandwidth_rad_s: Number,
    friction_switch_motor_rad_s: Number,
}

/// Where each value stands in the text, by joint and by the name [`Robot::check`] uses.
#[derive(Default)]
struct Places(HashMap<(Option<usize>, &'static str), usize>);

struct Reader<'a> {
    text: &'a TomlText<'a>,
    places: Places,
}

impl Reader<'_> {
    /// Notes where an optional value stands, and gives it.
    fn optional(&mut self, joint: Option<usize>, field: &'static str, value: &Number) -> Option<f64> {
        let value = value.as_ref()?;
        self.places.0.insert((joint, field), value.span().start);
        Some(*value.get_ref())
    }

    /// A joint's value that must be there, under its usual name or a linear axis's.
    fn joint_value(
        &mut self,
        joint: (usize, &RawJoint),
        field: &'static str,
        value: &Number,
        linear: Option<(&str, &Number)>,
    ) -> Result<f64, FileError> {
        let (index, raw) = joint;
        let other = linear.and_then(|(_, value)| value.as_ref());
        if let (Some(_), Some(other), Some((name, _))) = (value, other, linear) {
            return Err(self.text.error(
                Some(other.span().start),
                Problem::Value {
                    field: format!("{name} of joint \"{}\"", raw.name.get_ref()),
                    value: other.get_ref().to_string(),
                    limit: format!("absent where {field} is given"),
                },
                "keep one of the two",
            ));
        }
        match value.as_ref().or(other) {
            Some(found) => {
                self.places.0.insert((Some(index), field), found.span().start);
                Ok(*found.get_ref())
            }
            None => {
                let or = linear.map(|(name, _)| format!(" (or {name})")).unwrap_or_default();
                Err(self.text.error(
                    Some(raw.name.span().start),
                    Problem::Missing { field: format!("{field}{or} of joint \"{}\"", raw.name.get_ref()) },
                    "add the key to its [[joint]] table",
                ))
            }
        }
    }

    fn joint(&mut self, index: usize, raw: &RawJoint, unit: Unit) -> Result<Joint, FileError> {
        let at = (index, raw);
        let this = Some(index);
        self.places.0.insert((this, "name"), raw.name.span().start);
        let law = match raw.law {
            RawLaw::Proportional => {
                let gain = &raw.position_gain_a_per_count;
                let gain_a_per_count = self.joint_value(at, "position_gain_a_per_count", gain, None)?;
                let lead = self.optional(this, "lead", &raw.lead).unwrap_or(0.0);
                Law::Proportional(PositionLoop { gain_a_per_count, lead })
            }
            RawLaw::Cascade => Law::Cascade {
                position_gain_per_s: self.joint_value(at, "position_gain_per_s", &raw.position_gain_per_s, None)?,
                velocity_gain: self.joint_value(at, "velocity_gain", &raw.velocity_gain, None)?,
            },
        };
        // A linear axis has no gear: its "radian" is a metre, so 2π "radians" hold 2π · counts_per_unit counts.
        let gear_ratio = match unit {
            Unit::Metre => self.optional(this, "gear_ratio", &raw.gear_ratio).unwrap_or(1.0),
            Unit::Radian => self.joint_value(at, "gear_ratio", &raw.gear_ratio, None)?,
        };
        let counts_per_rev = match &raw.counts_per_unit {
            Some(_) => {
                let alias = Some(("counts_per_unit", &raw.counts_per_unit));
                std::f64::consts::TAU * self.joint_value(at, "counts_per_rev", &raw.counts_per_rev, alias)?
            }
            None => self.joint_value(at, "counts_per_rev", &raw.counts_per_rev, Some(("counts_per_unit", &None)))?,
        };
        let defaults = JointLimits::not_given(index, unit);
        Ok(Joint {
            name: raw.name.get_ref().clone(),
            gear_ratio,
            counts_per_rev,
            torque_constant_nm_per_a: self.joint_value(
                at,
                "torque_constant_nm_per_a",
                &raw.torque_constant_nm_per_a,
                Some(("actuator_gain", &raw.actuator_gain)),
            )?,
            current_limit_a: self.joint_value(
                at,
                "current_limit_a",
                &raw.current_limit_a,
                Some(("command_limit", &raw.command_limit)),
            )?,
            law,
            viscous_friction_nm_s_per_rad: self.optional(
                this,
                "viscous_friction_nm_s_per_rad",
                &raw.viscous_friction_nm_s_per_rad,
            ),
            coulomb_friction_nm: self.optional(this, "coulomb_friction_nm", &raw.coulomb_friction_nm),
            current_full_scale_a: self
                .optional(this, "current_full_scale_a", &raw.current_full_scale_a)
                .unwrap_or(DEFAULT_FULL_SCALE_A),
            limits: JointLimits {
                position_low_rad: self
                    .optional(this, "position_low_rad", &raw.position_low_rad)
                    .unwrap_or(defaults.position_low_rad),
                position_high_rad: self
                    .optional(this, "position_high_rad", &raw.position_high_rad)
                    .unwrap_or(defaults.position_high_rad),
                speed_rad_s: self
                    .optional(this, "speed_limit_rad_s", &raw.speed_limit_rad_s)
                    .unwrap_or(defaults.speed_rad_s),
                acceleration_rad_s2: self
                    .optional(this, "acceleration_limit_rad_s2", &raw.acceleration_limit_rad_s2)
                    .unwrap_or(defaults.acceleration_rad_s2),
            },
        })
    }

    fn gripper(&mut self, raw: &RawGripper) -> Gripper {
        self.places.0.insert((None, "maximum_load_kg"), raw.maximum_load_kg.span().start);
        self.places.0.insert((None, "grasp_m"), raw.grasp_m.span().start);
        Gripper { maximum_load_kg: *raw.maximum_load_kg.get_ref(), grasp_m: *raw.grasp_m.get_ref() }
    }

    fn computed_torque(&mut self, raw: &RawComputedTorque) -> ComputedTorqueSettings<f64> {
        let default = ComputedTorqueSettings::at_record_period();
        let mut value = |field, raw: &Number, default: f64| self.optional(None, field, raw).unwrap_or(default);
        ComputedTorqueSettings {
            bandwidth_rad_s: value("bandwidth_rad_s", &raw.bandwidth_rad_s, default.bandwidth_rad_s),
            damping_ratio: value("damping_ratio", &raw.damping_ratio, default.damping_ratio),
            observer_bandwidth_rad_s: value(
                "observer_bandwidth_rad_s",
                &raw.observer_bandwidth_rad_s,
                default.observer_bandwidth_rad_s,
            ),
            friction_switch_motor_rad_s: value(
                "friction_switch_motor_rad_s",
                &raw.friction_switch_motor_rad_s,
                default.friction_switch_motor_rad_s,
            ),
        }
    }

    fn search(&mut self, raw: &BTreeMap<Spanned<String>, Spanned<[f64; 2]>>) -> Result<[[f64; 2]; 9], FileError> {
        let mut search = default_search();
        for (key, range) in raw {
            let number = key.get_ref().strip_prefix('f').and_then(|number| number.parse::<usize>().ok());
            let Some(slot) = number.and_then(|number| search.get_mut(number.wrapping_sub(1))) else {
                return Err(self.text.error(
                    Some(key.span().start),
                    Problem::Value {
                        field: "a key of [search]".into(),
                        value: format!("`{}`", key.get_ref()),
                        limit: "one of f1 to f9".into(),
                    },
                    "correct the key",
                ));
            };
            *slot = *range.get_ref();
            self.places.0.entry((None, "search")).or_insert(range.span().start);
            let [low, high] = *range.get_ref();
            if !(low.is_finite() && high.is_finite() && low < high) {
                return Err(self.text.error(
                    Some(range.span().start),
                    Problem::Value {
                        field: format!("search.{}", key.get_ref()),
                        value: format!("[{low}, {high}]"),
                        limit: "a range [low, high] with low below high".into(),
                    },
                    "correct the range",
                ));
            }
        }
        Ok(search)
    }
}

fn parse(text: &TomlText<'_>) -> Result<(Robot, Places), FileError> {
    let raw: RawRobot = text.parse()?;
    let mut reader = Reader { text, places: Places::default() };
    let (kind, default_gravity) = match raw.kind {
        RawKind::TwoLink => (Kind::TwoLink, 9.81),
        RawKind::SingleAxis => (Kind::SingleAxis, 0.0),
    };
    let unit = if raw.unit == RawUnit::Metre { Unit::Metre } else { Unit::Radian };
    let joints =
        raw.joint.iter().enumerate().map(|(index, raw)| reader.joint(index, raw, unit)).collect::<Result<_, _>>()?;
    let search = reader.search(&raw.search)?;
    let gripper = raw.gripper.as_ref().map(|raw| reader.gripper(raw));
    let computed_torque = reader.computed_torque(&raw.computed_torque);
    let record_period_s = *raw.record_period_s.get_ref();
    reader.places.0.insert((None, "record_period_s"), raw.record_period_s.span().start);
    let mut robot = Robot {
        name: raw.name,
        kind,
        unit,
        gravity_m_s2: reader.optional(None, "gravity_m_s2", &raw.gravity_m_s2).unwrap_or(default_gravity),
        record_period_s,
        loop_period_s: reader.optional(None, "loop_period_s", &raw.loop_period_s).unwrap_or(record_period_s),
        command_delay_s: reader.optional(None, "command_delay_s", &raw.command_delay_s).unwrap_or(0.0),
        counts_per_tick_limit: reader.optional(None, "counts_per_tick_limit", &raw.counts_per_tick_limit),
        upper_arm_m: reader.optional(None, "upper_arm_m", &raw.upper_arm_m).unwrap_or(PUMA_UPPER_ARM_M),
        following_error_limit_counts: reader.optional(
            None,
            "following_error_limit_counts",
            &raw.following_error_limit_counts,
        ),
        quantised: raw.quantised,
        current_is_command: raw.current_is_command,
        joints,
        gripper,
        computed_torque,
        search,
    };
    if robot.gripper.is_none() && robot.kind == Kind::TwoLink && robot.expected_f() == REFERENCE_F {
        robot.gripper = Some(Gripper::REFERENCE);
    }
    robot.check().map_err(|error| {
        let offset = reader.places.0.get(&(error.joint, error.field)).copied();
        let joint = error.joint.and_then(|index| robot.joints.get(index));
        let of_joint = joint.map(|joint| format!(" of joint \"{}\"", joint.name)).unwrap_or_default();
        let problem = Problem::Value {
            field: format!("{}{of_joint}", error.field),
            value: error.value,
            limit: error.limit.into(),
        };
        text.error(offset, problem, error.remedy)
    })?;
    Ok((robot, reader.places))
}

pub(super) fn read(path: &Path) -> Result<Robot, FileError> {
    parse(&TomlText::read(path)?).map(|(robot, _)| robot)
}

pub(super) fn read_for_motion(path: &Path) -> Result<Robot, FileError> {
    let text = TomlText::read(path)?;
    let (robot, places) = parse(&text)?;
    for (index, joint) in robot.joints.iter().enumerate() {
        // No board drives a single axis: that is told where the board is asked, and no friction would help.
        if robot.kind == Kind::TwoLink && joint.viscous_friction_nm_s_per_rad.is_none() {
            return Err(text.error(
                places.0.get(&(Some(index), "name")).copied(),
                Problem::Missing { field: format!("viscous_friction_nm_s_per_rad of joint \"{}\"", joint.name) },
                "the stability limit of the gain follows from it; add an estimate, rather too small than too large",
            ));
        }
    }
    check_own_limits(&text, &robot, &places)?;
    check_gains(&text, &robot, &places, "nothing was moved")?;
    Ok(robot)
}

/// Refuses to move another arm than the reference robot within the reference robot's limits.
fn check_own_limits(text: &TomlText<'_>, robot: &Robot, places: &Places) -> Result<(), FileError> {
    const LIMITS: [&str; 4] =
        ["position_low_rad", "position_high_rad", "speed_limit_rad_s", "acceleration_limit_rad_s2"];
    if robot.kind == Kind::SingleAxis || robot.expected_f() == REFERENCE_F {
        return Ok(());
    }
    for (index, joint) in robot.joints.iter().enumerate() {
        if let Some(limit) = LIMITS.iter().find(|limit| !places.0.contains_key(&(Some(index), **limit))) {
            return Err(text.error(
                places.0.get(&(Some(index), "name")).copied(),
                Problem::Missing { field: format!("{limit} of joint \"{}\"", joint.name) },
                "[search] describes another arm than the reference robot, whose limits are not this one's; add it",
            ));
        }
    }
    Ok(())
}

pub(super) fn read_for_repeating(path: &Path) -> Result<Robot, FileError> {
    let text = TomlText::read(path)?;
    let (robot, places) = parse(&text)?;
    check_gains(&text, &robot, &places, "no recording comes from an unstable loop: correct the robot file")?;
    Ok(robot)
}

fn check_gains(text: &TomlText<'_>, robot: &Robot, places: &Places, remedy: &str) -> Result<(), FileError> {
    robot.check_gains().map_err(|error| {
        text.error(
            places.0.get(&(Some(error.index), "position_gain_a_per_count")).copied(),
            Problem::Unstable { joint: error.joint, source: error.source },
            remedy,
        )
    })
}

/// Parses a robot file's bytes; `path` only names them in errors.
pub(super) fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Robot, FileError> {
    parse(&TomlText::from_bytes(path, bytes)?).map(|(robot, _)| robot)
}
