//! The library by name.

use shared::effects::Effects;
use shared::effects::catalogue::{LIBRARY, Role, Scope, find};

/// The contract's names, in its order.
const NAMES: [&str; 26] = [
    "coulomb-friction",
    "viscous-friction",
    "asymmetric-friction",
    "asymmetric-viscous-friction",
    "stribeck-friction",
    "load-dependent-friction",
    "position-dependent-friction",
    "friction-drift",
    "quadratic-friction",
    "torque-offset",
    "torque-constant",
    "torque-ripple",
    "cogging",
    "transmission-error",
    "joint-flexibility",
    "backlash",
    "current-lag",
    "current-saturation",
    "voltage-saturation",
    "back-emf",
    "amplifier-dead-zone",
    "payload",
    "gravity-spring",
    "base-tilt",
    "count-loss",
    "external-contact",
];

#[test]
fn library_has_the_contracts_names() {
    let found: Vec<&str> = LIBRARY.iter().map(|entry| entry.name).collect();
    assert_eq!(found, NAMES);
}

#[test]
fn every_parameter_is_kept_where_only_it_is() {
    for entry in LIBRARY {
        for (index, parameter) in entry.parameters.iter().enumerate() {
            assert_eq!(parameter.role == Role::Size, index == 0, "{}: the size comes first", entry.name);
            for joint in 0..2 {
                let mut effects = Effects::OFF;
                parameter.set(&mut effects, joint, 0.123);
                assert_eq!(parameter.get(&effects, joint), 0.123);
                assert_ne!(effects, Effects::OFF);
                assert_eq!(entry.is_on(&effects, joint), index == 0, "{} {}", entry.name, parameter.name);
                if entry.scope == Scope::Joint {
                    assert!(!entry.is_on(&effects, 1 - joint));
                }
                parameter.set(&mut effects, joint, parameter.neutral());
                assert_eq!(effects, Effects::OFF);
            }
            assert!(parameter.accepts(parameter.typical) && parameter.accepts(parameter.neutral()));
            assert!(!parameter.accepts(f64::NAN));
        }
    }
}

#[test]
fn no_two_effects_share_a_size() {
    for entry in LIBRARY {
        let mut effects = Effects::OFF;
        entry.size().set(&mut effects, 0, entry.size().typical);
        let on: Vec<&str> = LIBRARY.iter().filter(|other| other.is_on(&effects, 0)).map(|other| other.name).collect();
        assert_eq!(on, [entry.name]);
    }
}

#[test]
fn effects_alike_are_of_the_library() {
    for entry in LIBRARY {
        for name in entry.alike {
            assert!(find(name).is_some() && *name != entry.name, "{}: {name}", entry.name);
        }
    }
    assert!(find("wear").is_none());
}
