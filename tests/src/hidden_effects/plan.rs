//! Which cases a benchmark consists of.

use super::library::{self, OF_BOTH_JOINTS};
use super::outside;

/// What is hidden in a case.
#[derive(Clone, Debug, PartialEq)]
pub enum Hidden {
    /// Nothing.
    Null,
    /// One effect of the library.
    Single {
        /// Its name.
        name: &'static str,
        /// Joint 0 or 1.
        joint: usize,
    },
    /// One fault outside the library.
    Outside {
        /// Its name.
        name: &'static str,
        /// Joint 0 or 1.
        joint: usize,
    },
    /// Two effects of the library, drawn by the case.
    Pair,
}

/// Size of an effect relative to a clear one, with its name in tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tier {
    /// Its name.
    pub name: &'static str,
    /// Its size.
    pub size: f64,
}

/// From clear to where naming must fail; and, last, what breaks the arm more than a model close to it can follow.
pub const TIERS: [Tier; 6] = [
    Tier { name: "clear", size: 1.0 },
    Tier { name: "medium", size: 0.4 },
    Tier { name: "small", size: 0.15 },
    Tier { name: "tiny", size: 0.05 },
    Tier { name: "hardly", size: 0.015 },
    Tier { name: "large", size: 2.5 },
];

/// One case to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// What is hidden.
    pub hidden: Hidden,
    /// How strong; the first tier for a null.
    pub tier: Tier,
    /// With correlated torque noise.
    pub noisy: bool,
}

/// How many cases of each kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Specification {
    /// Seeds per library effect, joint and tier.
    pub effects: usize,
    /// Cases with nothing hidden.
    pub nulls: usize,
    /// Seeds per fault outside, joint, and the two upper tiers.
    pub outside: usize,
    /// Cases with two effects.
    pub pairs: usize,
    /// Tiers of library effects by name; all if empty.
    pub tiers: Vec<String>,
    /// Library effects and faults by name; all if empty.
    pub only: Vec<String>,
}

/// What is wrong with a specification.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpecificationError {
    /// A part without `=` or with an unknown key.
    #[error("`{0}` is not one of smoke, standard, full, effects=N, nulls=N, outside=N, pairs=N, tiers=A+B, only=A+B")]
    Key(String),
    /// A number that is none.
    #[error("{key}={value}: not a whole number")]
    Number {
        /// The key.
        key: String,
        /// Its value.
        value: String,
    },
    /// A name that does not exist.
    #[error("there is no {kind} `{name}`; there are {known}")]
    Name {
        /// Tier or effect.
        kind: &'static str,
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
}

impl std::str::FromStr for Specification {
    type Err = SpecificationError;

    /// `smoke`, `standard`, `full`, or parts like `effects=2,nulls=300,outside=1,pairs=40,tiers=clear+small,only=cogging`;
    /// a part after a word changes it.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut found = Self { effects: 0, nulls: 0, outside: 0, pairs: 0, tiers: Vec::new(), only: Vec::new() };
        for part in text.split(',').filter(|part| !part.is_empty()) {
            let counts = match part {
                "smoke" => Some([0, 3, 0, 0]),
                "standard" => Some([1, 100, 1, 30]),
                "full" => Some([2, 300, 2, 80]),
                _ => None,
            };
            if let Some([effects, nulls, outside, pairs]) = counts {
                (found.effects, found.nulls, found.outside, found.pairs) = (effects, nulls, outside, pairs);
                if part == "smoke" {
                    found.effects = 1;
                    found.tiers = vec!["clear".to_owned()];
                }
                continue;
            }
            let (key, value) = part.split_once('=').ok_or_else(|| SpecificationError::Key(part.to_owned()))?;
            let number = || {
                value
                    .parse::<usize>()
                    .map_err(|_| SpecificationError::Number { key: key.to_owned(), value: value.to_owned() })
            };
            let names = || value.split('+').map(str::to_owned).collect::<Vec<_>>();
            match key {
                "effects" => found.effects = number()?,
                "nulls" => found.nulls = number()?,
                "outside" => found.outside = number()?,
                "pairs" => found.pairs = number()?,
                "tiers" => found.tiers = names(),
                "only" => found.only = names(),
                _ => return Err(SpecificationError::Key(part.to_owned())),
            }
        }
        let check = |kind: &'static str, names: &[String], known: Vec<&str>| match names
            .iter()
            .find(|name| !known.contains(&name.as_str()))
        {
            Some(name) => Err(SpecificationError::Name { kind, name: name.clone(), known: known.join(", ") }),
            None => Ok(()),
        };
        check("tier", &found.tiers, TIERS.iter().map(|tier| tier.name).collect())?;
        check("effect", &found.only, library::NAMES.into_iter().chain(outside::NAMES).collect())?;
        Ok(found)
    }
}

impl Specification {
    /// All cases, in a fixed order. Every second one is noisy, within each kind.
    #[must_use]
    pub fn cases(&self) -> Vec<Planned> {
        let wanted = |name: &str| self.only.is_empty() || self.only.iter().any(|only| only == name);
        let tiers = || {
            TIERS.into_iter().filter(|tier| self.tiers.is_empty() || self.tiers.iter().any(|name| name == tier.name))
        };
        let mut cases = Vec::new();
        // Alternates along the innermost running numbers, and from one tier and joint to the next.
        let noisy = |tier: usize, joint: usize, seed: usize| (tier + joint + seed) % 2 == 1;
        for name in library::NAMES.into_iter().filter(|name| wanted(name)) {
            for (tier_index, tier) in tiers().enumerate() {
                for joint in 0..2 {
                    for seed in 0..self.effects {
                        // What belongs to no joint alone is drawn twice instead.
                        let joint_of = if OF_BOTH_JOINTS.contains(&name) { 0 } else { joint };
                        cases.push(Planned {
                            hidden: Hidden::Single { name, joint: joint_of },
                            tier,
                            noisy: noisy(tier_index, joint, seed),
                        });
                    }
                }
            }
        }
        for name in outside::NAMES.into_iter().filter(|name| wanted(name)) {
            for (tier_index, tier) in TIERS.into_iter().take(2).enumerate() {
                for joint in 0..2 {
                    for seed in 0..self.outside {
                        cases.push(Planned {
                            hidden: Hidden::Outside { name, joint },
                            tier,
                            noisy: noisy(tier_index, joint, seed),
                        });
                    }
                }
            }
        }
        for seed in 0..self.nulls {
            cases.push(Planned { hidden: Hidden::Null, tier: TIERS[0], noisy: seed % 2 == 1 });
        }
        for seed in 0..self.pairs {
            cases.push(Planned { hidden: Hidden::Pair, tier: TIERS[(seed / 2) % 2], noisy: seed % 2 == 1 });
        }
        cases
    }
}
