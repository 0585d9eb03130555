//! The file of bounds: the length of the upper arm, and a table for each link.

use std::fmt;
use std::path::Path;

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use toml::Spanned;

use super::{ArmBounds, Bounds, LinkBounds};
use crate::edit_distance::nearest;
use crate::file_error::{FileError, Problem};
use crate::robot::Robot;
use crate::toml_text::TomlText;

const UPPER_ARM: &str = "upper_arm_m";

/// What the tables of the two links may be called: like the joints they turn about, as in a URDF; counted, as `new-robot`
/// counts them; or as the paper numbers them.
fn namings(joints: &[String; 2]) -> [[String; 2]; 3] {
    let counted = |numbers: [u8; 2]| numbers.map(|number| format!("link{number}"));
    [joints.each_ref().map(|joint| format!("link_{joint}")), counted([1, 2]), counted([2, 3])]
}

/// The file as it stands.
struct RawBounds {
    upper_arm_m: Option<Spanned<f64>>,
    links: Vec<(Spanned<String>, Spanned<LinkBounds>)>,
    /// The first key that is neither.
    unknown: Option<Spanned<String>>,
}

impl<'de> Deserialize<'de> for RawBounds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Tables)
    }
}

/// Reads tables of links by any name: which names are meant, only the robot file says.
struct Tables;

impl<'de> Visitor<'de> for Tables {
    type Value = RawBounds;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("bounds on the links of an arm")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<RawBounds, A::Error> {
        let (mut upper_arm_m, mut links, mut unknown) = (None, Vec::new(), None);
        while let Some(key) = map.next_key::<Spanned<String>>()? {
            if key.get_ref() == UPPER_ARM {
                upper_arm_m = Some(map.next_value()?);
            } else if key.get_ref().starts_with("link") {
                links.push((key, map.next_value()?));
            } else {
                map.next_value::<IgnoredAny>()?;
                unknown.get_or_insert(key);
            }
        }
        Ok(RawBounds { upper_arm_m, links, unknown })
    }
}

pub(super) fn read(path: &Path, robot: &Robot) -> Result<ArmBounds, FileError> {
    let text = TomlText::read(path)?;
    let raw: RawBounds = text.parse()?;
    let joint = |index: usize| robot.joints.get(index);
    let joints = [0, 1].map(|index| joint(index).map_or_else(|| (index + 2).to_string(), |joint| joint.name.clone()));
    let refuse = |offset: usize, field: String, value: String, limit: &str| {
        let problem = Problem::Value { field, value, limit: limit.into() };
        Err(text.error(Some(offset), problem, "correct the bounds"))
    };
    // A key that is misspelt is told before the one that it was meant to be is missing.
    let links = named(&text, &raw, &joints)?;
    let Some(upper_arm) = &raw.upper_arm_m else {
        return Err(text.error(None, Problem::Missing { field: UPPER_ARM.into() }, "add the key"));
    };
    let upper_arm_m = *upper_arm.get_ref();
    if !(upper_arm_m.is_finite() && upper_arm_m > 0.0) {
        let limit = "a finite length above 0 in m";
        return refuse(upper_arm.span().start, UPPER_ARM.into(), upper_arm_m.to_string(), limit);
    }
    for (name, link) in links {
        for (field, [low, high], least) in fields(link.get_ref()) {
            if !(low.is_finite() && high.is_finite() && least <= low && low <= high) {
                let limit = "[least, greatest], finite, masses above 0 and inertias 0 or above";
                let field = format!("{}.{field}", name.get_ref());
                return refuse(link.span().start, field, format!("[{low}, {high}]"), limit);
            }
        }
    }
    Ok(ArmBounds {
        upper_arm_m,
        links: links.map(|(_, link)| *link.get_ref()),
        gear_ratios: [0, 1].map(|index| joint(index).map_or(1.0, |joint| joint.gear_ratio)),
        joints,
    })
}

type Table = (Spanned<String>, Spanned<LinkBounds>);

/// The tables of the upper arm and of the forearm.
fn named<'a>(text: &TomlText<'_>, raw: &'a RawBounds, joints: &[String; 2]) -> Result<[&'a Table; 2], FileError> {
    let namings = namings(joints);
    let of = |name: &String| raw.links.iter().find(|(key, _)| key.get_ref() == name);
    let found = namings.iter().find_map(|[upper, fore]| Some([of(upper)?, of(fore)?]));
    let [upper, fore] = &namings[0];
    let is_known = |key: &&Spanned<String>| namings.iter().flatten().any(|name| name == key.get_ref());
    let is_meant = |key: &&Spanned<String>| found.is_none_or(|found| found.iter().any(|(name, _)| name == *key));
    let stray = raw.links.iter().map(|(key, _)| key).find(|key| !(is_known(key) && is_meant(key)));
    if let Some(key) = raw.unknown.as_ref().or(stray) {
        let problem = Problem::Value {
            field: "a key of the bounds".into(),
            value: format!("`{}`", key.get_ref()),
            limit: format!("{UPPER_ARM}, [{upper}] or [{fore}]"),
        };
        let remedy = match nearest(key.get_ref(), [UPPER_ARM, upper, fore].into_iter()) {
            Some(meant) => format!("did you mean `{meant}`?"),
            None => "remove it, or check its spelling".into(),
        };
        return Err(text.error(Some(key.span().start), problem, remedy));
    }
    found.ok_or_else(|| {
        let remedy = "give each link a table, called like the joint it turns about";
        text.error(None, Problem::Missing { field: format!("one of [{upper}] and [{fore}]") }, remedy)
    })
}

/// Names, bounds, and the least value that can be.
fn fields(link: &LinkBounds) -> [(&'static str, Bounds, f64); 5] {
    [
        ("mass_kg", link.mass_kg, f64::MIN_POSITIVE),
        ("centre_x_m", link.centre_x_m, f64::NEG_INFINITY),
        ("centre_y_m", link.centre_y_m, f64::NEG_INFINITY),
        ("inertia_kg_m2", link.inertia_kg_m2, 0.0),
        ("motor_inertia_kg_m2", link.motor_inertia_kg_m2, 0.0),
    ]
}
