//! An effect of the library with values.

use shared::effects::Effects;

use super::library::{Kind, Parameter, Role, Search};

/// Least order of a torque of the motor's own, per turn of it: poles, slots and brushes all repeat at least once a turn. A
/// little below that, because an order that is fitted scatters.
const LEAST_MOTOR_ORDER: f64 = 0.8;

/// What pushes from before this moment of every recording, in s, is no contact that happens to come: something that starts
/// along with the robot.
const WITH_THE_START_S: f64 = 0.2;

/// An effect with values: one that is in a model, or tried.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Which.
    pub kind: &'static Kind,
    /// The joint's index; 0 for the whole arm's.
    pub joint: usize,
    /// A value for each parameter that all recordings share, none for the others.
    pub common: Vec<Option<f64>>,
    /// Values of the others, a list for each recording.
    pub records: Vec<Vec<f64>>,
}

impl Instance {
    /// With the values of its parameters in order, those of each recording the same.
    pub fn new(kind: &'static Kind, joint: usize, values: &[f64], records: usize) -> Self {
        let of = |per_record: bool| {
            kind.parameters.iter().zip(values).filter(move |(parameter, _)| parameter.per_record == per_record)
        };
        let common =
            kind.parameters.iter().zip(values).map(|(parameter, value)| (!parameter.per_record).then_some(*value));
        Self {
            kind,
            joint,
            common: common.collect(),
            records: vec![of(true).map(|(_, value)| *value).collect(); records],
        }
    }

    /// The joint's name in reports.
    pub fn joint_name(&self, robot: &crate::robot::Robot) -> String {
        if self.kind.of_arm && robot.joints.len() > 1 {
            return "both".into();
        }
        robot.joints[self.joint].name.clone()
    }

    /// Whether it comes at an instant of every recording's own.
    pub fn has_instants(&self) -> bool {
        matches!(self.kind.search, Search::Instant)
    }

    /// Every value with its parameter: the common ones first, then recording by recording.
    pub fn flat(&self) -> Vec<(&'static Parameter, f64)> {
        let common = self.kind.parameters.iter().zip(&self.common);
        let common = common.filter_map(|(parameter, value)| value.map(|value| (parameter, value)));
        let own = || self.kind.parameters.iter().filter(|parameter| parameter.per_record);
        let records = self.records.iter().flat_map(|values| own().zip(values.iter().copied()));
        common.chain(records).collect()
    }

    /// This with other values, in the order of [`Instance::flat`].
    pub fn with_flat(&self, values: &[f64]) -> Self {
        let mut values = values.iter().copied();
        let mut next = |old: f64| values.next().unwrap_or(old);
        let mut new = self.clone();
        new.common.iter_mut().flatten().for_each(|value| *value = next(*value));
        new.records.iter_mut().flatten().for_each(|value| *value = next(*value));
        new
    }

    /// This with a new value for each that a recording has for itself.
    pub fn with_own(&self, new: impl Fn(f64) -> f64) -> Self {
        let mut with = self.clone();
        with.records.iter_mut().flatten().for_each(|value| *value = new(*value));
        with
    }

    /// This with a wave's amplitude above 0: below, it is the same wave half a turn on.
    pub fn upright(&self) -> Self {
        let mut new = self.clone();
        let phases = || self.kind.parameters.iter().filter(|parameter| parameter.role == Role::Phase);
        // An angle of a spring, too, turns its torque round.
        if phases().count() != 1 || self.common[0].is_none_or(|size| size >= 0.0) {
            return new;
        }
        new.common[0] = self.common[0].map(|size| -size);
        for (parameter, value) in self.kind.parameters.iter().zip(&mut new.common) {
            if let Some(value) = value.as_mut().filter(|_| parameter.role == Role::Phase) {
                *value += std::f64::consts::PI;
            }
        }
        let own: Vec<&Parameter> = self.kind.parameters.iter().filter(|parameter| parameter.per_record).collect();
        for values in &mut new.records {
            for (_, value) in own.iter().zip(values).filter(|(parameter, _)| parameter.role == Role::Phase) {
                *value += std::f64::consts::PI;
            }
        }
        new
    }

    /// Whether its size is one that counts as an effect: an encoder loses whole counts, no torque constant is known to two
    /// thousandths, a contact has a length and does not begin with every recording, and a motor's own torque repeats with its
    /// turn, not more slowly.
    pub fn can_be(&self) -> bool {
        let least = match self.kind.name {
            "count-loss" => 0.9,
            "torque-constant" => 2e-3,
            // Without any there is no second mass: what it brings, its motor's inertia does.
            "joint-flexibility" | "backlash" => f64::MIN_POSITIVE,
            _ => 0.0,
        };
        let lasts = |(parameter, value): (&Parameter, &Option<f64>)| {
            parameter.role != Role::Moment || value.is_none_or(|value| value > parameter.range[0])
        };
        let of_motor = matches!(self.kind.name, "cogging" | "torque-ripple");
        let repeats = |(parameter, value): (&Parameter, &Option<f64>)| {
            !of_motor || parameter.name != "order" || value.is_none_or(|order| order >= LEAST_MOTOR_ORDER)
        };
        let from_the_start = self.kind.name == "external-contact"
            && self.records.len() > 1
            && self.records.iter().flatten().all(|&start_s| start_s < WITH_THE_START_S);
        !from_the_start
            && self.common[0].is_none_or(|size| size.abs() >= least)
            && self.kind.parameters.iter().zip(&self.common).all(repeats)
            && self.kind.parameters.iter().zip(&self.common).all(lasts)
    }

    /// Puts it into the effects of one recording.
    pub fn apply(&self, effects: &mut Effects<f64>, record: usize) {
        let mut own = self.records.get(record).into_iter().flatten();
        for (parameter, common) in self.kind.parameters.iter().zip(&self.common) {
            let value = match common {
                Some(value) => Some(value),
                None => own.next(),
            };
            if let Some(&value) = value {
                *parameter.of(effects, self.joint) = value;
            }
        }
    }
}
