//! Backlash and flexibility of one joint are one thing: a gap between teeth that give. How stiff a gear's teeth are no
//! simulation and no robot agree on, so that a spring beside a gap is part of the gap, not an effect of its own.

use super::decide::{Accepted, Rival};
use super::findings::Finding;
use super::instance::Instance;

const GAP: &str = "backlash";
const SPRING: &str = "joint-flexibility";
/// By what factor one of the two has to narrow the gap to the measurement that the other leaves.
const NARROWS: f64 = 0.95;
/// Fewer lost counts than this are no slip of an encoder where teeth play.
const FEW_COUNTS: f64 = 3.0;

/// By what factor a rival beside `accepted` effects has to narrow the gap that they leave; none where it is not the other
/// half of one of them.
pub fn has_to_narrow(rival: &Rival, accepted: &[Accepted]) -> Option<f64> {
    let of_shaft = |name: &str| matches!(name, GAP | SPRING);
    let instance = &rival.instance;
    let beside = accepted.iter().any(|other| of_shaft(other.name) && other.joint == instance.joint);
    (of_shaft(instance.kind.name) && beside).then_some(NARROWS)
}

/// Whether a rival beside `accepted` effects is a count or two that seem to be lost by a joint whose teeth play or give: teeth
/// that are a little different leave that much.
pub fn is_their_fault(rival: &Rival, accepted: &[Accepted]) -> bool {
    let instance = &rival.instance;
    let beside = accepted.iter().any(|other| matches!(other.name, GAP | SPRING) && other.joint == instance.joint);
    instance.kind.name == "count-loss" && beside && instance.common[0].is_some_and(|counts| counts.abs() < FEW_COUNTS)
}

/// How many effects `accepted` are, gap and spring of one joint taken for one.
pub fn count(accepted: &[Accepted]) -> usize {
    let gap_of = |joint: usize| accepted.iter().any(|other| other.name == GAP && other.joint == joint);
    accepted.iter().filter(|one| one.name != SPRING || !gap_of(one.joint)).count()
}

/// `found` with the spring beside a gap made part of the gap's finding, where the first of the two stood.
pub fn merged(found: Vec<(Finding, Instance)>) -> Vec<(Finding, Instance)> {
    let mut merged: Vec<(Finding, Instance)> = Vec::new();
    for (finding, instance) in found {
        let other = match finding.name {
            GAP => SPRING,
            SPRING => GAP,
            _ => "",
        };
        let Some(first) = merged.iter_mut().find(|(first, _)| first.name == other && first.joint == finding.joint)
        else {
            merged.push((finding, instance));
            continue;
        };
        // Both have the motor's inertia; the model takes that of the later one.
        let mut parameters = first.0.parameters.clone();
        parameters.extend(finding.parameters.clone());
        let delta_bic = first.0.delta_bic + finding.delta_bic;
        if finding.name == GAP {
            *first = (finding, instance);
        }
        first.0.parameters = parameters;
        first.0.delta_bic = delta_bic;
    }
    merged
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::explain::findings::FoundParameter;
    use crate::explain::library::kind;

    fn finding(name: &'static str, joint: usize, parameter: &str) -> (Finding, Instance) {
        let value = FoundParameter { value: 1.0, standard_error: None, unit: "" };
        let finding = Finding {
            name,
            joint: joint.to_string(),
            class: vec![name],
            parameters: BTreeMap::from([(parameter.to_owned(), value)]),
            place: String::new(),
            delta_bic: 10.0,
        };
        (finding, Instance::new(kind(name).expect("an effect"), joint, &[1.0], 1))
    }

    #[test]
    fn a_count_or_two_beside_teeth_are_theirs() {
        let gap = Accepted { name: GAP, joint: 1, class: Vec::new(), delta_bic: 500.0 };
        let slip = |joint: usize, counts: f64| Rival {
            instance: Instance::new(kind("count-loss").expect("an effect"), joint, &[counts, 1.0], 2),
            delta_bic: 80.0,
            held_out_gap: 0.4,
        };
        assert!(is_their_fault(&slip(1, -2.0), std::slice::from_ref(&gap)));
        // A slip of an encoder is more than that, or of the other joint, or beside no teeth.
        assert!(!is_their_fault(&slip(1, -14.0), std::slice::from_ref(&gap)));
        assert!(!is_their_fault(&slip(0, -2.0), std::slice::from_ref(&gap)));
        assert!(!is_their_fault(&slip(1, -2.0), &[]));
    }

    #[test]
    fn a_spring_beside_a_gap_is_part_of_it() {
        let found = vec![
            finding(SPRING, 1, "compliance_rad_per_nm"),
            finding("cogging", 1, "order"),
            finding(GAP, 1, "gap_rad"),
            finding(SPRING, 0, "compliance_rad_per_nm"),
        ];
        let accepted: Vec<Accepted> = found
            .iter()
            .map(|(one, at)| Accepted { name: one.name, joint: at.joint, class: Vec::new(), delta_bic: 10.0 })
            .collect();
        assert_eq!(count(&accepted), 3);
        let merged = merged(found);
        let names: Vec<&str> = merged.iter().map(|(finding, _)| finding.name).collect();
        assert_eq!(names, [GAP, "cogging", SPRING]);
        assert!(merged[0].0.parameters.contains_key("compliance_rad_per_nm"));
        assert!(merged[0].0.parameters.contains_key("gap_rad"));
        assert_eq!((merged[0].0.delta_bic, merged[0].1.kind.name), (20.0, GAP));
    }
}
