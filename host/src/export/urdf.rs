//! A model as a URDF robot: bodies that give its f, joints with its friction, and a comment on what f leaves open.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;

use super::bodies::{Bodies, BodiesError, bodies};
use crate::links::ArmBounds;
use crate::model::Model;
use crate::robot::{Joint, Kind, Robot, Unit};

/// `model` of `robot` as URDF.
///
/// The frames are those of f: joint 2 turns about the world's y axis, z is up, and at zero angles link 2 points along the
/// world's x and its own y axis points down. The inertia of a rotor, which URDF itself has no place for, stands in the
/// `drake:` elements of the transmission. `bounds` says what the links may be; without it what f leaves open is chosen as
/// [`super::bodies`] says.
pub fn model_urdf(model: &Model, robot: &Robot, bounds: Option<&ArmBounds>) -> Result<String, BodiesError> {
    match robot.kind {
        Kind::TwoLink => {
            let bodies = bodies(model, robot, bounds)?;
            Ok(two_links(model, robot, &bodies))
        }
        Kind::SingleAxis => Ok(single_axis(model, robot)),
    }
}

fn two_links(model: &Model, robot: &Robot, bodies: &Bodies) -> String {
    let mut text = head(robot);
    comment(&mut text, &two_link_notes(model, robot, bodies));
    text.push_str("  <link name=\"base\"/>\n");
    let parents = ["base".to_string(), link_name(&robot.joints[0])];
    let origins =
        [format!("xyz=\"0 0 0\" rpy=\"{:?} 0 0\"", -FRAC_PI_2), format!("xyz=\"{:?} 0 0\"", robot.upper_arm_m)];
    for (index, joint) in robot.joints.iter().enumerate().take(2) {
        let link = &bodies.links[index];
        body(&mut text, &link_name(joint), link.mass_kg, link.centre_m, link.inertia_kg_m2);
        connect(&mut text, model, robot, index, &parents[index], &origins[index], "revolute", "0 0 1");
        transmission(&mut text, joint, Some(link.motor_inertia_kg_m2));
    }
    text.push_str("</robot>\n");
    text
}

fn two_link_notes(model: &Model, robot: &Robot, bodies: &Bodies) -> Vec<String> {
    let mut notes = Vec::new();
    if bodies.distance > 1e-3 {
        notes.push(format!(
            "No bodies on an upper arm of {} m give exactly the model's f; these give the nearest, {:.2} standard errors away:",
            robot.upper_arm_m,
            bodies.distance
        ));
    } else {
        notes.push("These bodies give the model's f:".into());
    }
    for (index, (found, given)) in bodies.f.iter().zip(model.f).enumerate() {
        notes.push(format!("  f{} = {found:.6} (model {given:.6})", index + 1));
    }
    notes.push("The data determine f alone. They do not determine:".into());
    let how = |rule: &str| if bodies.bounded { "chosen within the bounds".to_string() } else { rule.to_string() };
    notes.push(format!("  the mass of each link ({})", how("chosen as a uniform rod would have it")));
    notes.push(format!(
        "  the rotor inertia of motor {} ({})",
        robot.joints[0].name,
        how("taken like the other motor's, at most half of the inertia about its joint")
    ));
    notes.push("  ixx and iyy: the arm moves in a plane and shows izz alone (all three are taken equal)".into());
    notes.push("  the height z of each centre of mass above that plane (0)".into());
    notes.extend(effect_notes(model));
    notes
}

fn single_axis(model: &Model, robot: &Robot) -> String {
    let mut text = head(robot);
    let moved = model.f[6];
    let joint = &robot.joints[0];
    let linear = robot.unit == Unit::Metre;
    let mut notes = Vec::new();
    // A body whose mass alone matters still needs an inertia, and one whose inertia alone matters a mass.
    const RADIUS_OF_GYRATION_M: f64 = 0.1;
    let (mass_kg, inertia_kg_m2, kind, origin, axis) = if linear {
        notes.push(format!("The data determine the moving mass alone, rotor and screw included: {moved:.6} kg."));
        (moved, moved * RADIUS_OF_GYRATION_M.powi(2), "prismatic", "xyz=\"0 0 0\"".to_string(), "1 0 0")
    } else {
        notes.push(format!("The data determine the moving inertia alone, the rotor's included: {moved:.6} kg m²."));
        let mass_kg = moved / RADIUS_OF_GYRATION_M.powi(2);
        (mass_kg, moved, "revolute", format!("xyz=\"0 0 0\" rpy=\"{:?} 0 0\"", -FRAC_PI_2), "0 0 1")
    };
    let open = if linear { "inertias and the centre of mass" } else { "mass, ixx and iyy and the centre of mass" };
    notes.push(format!(
        "They do not determine {open} (taken with a radius of gyration of {RADIUS_OF_GYRATION_M} m, in the origin)."
    ));
    if !limits(joint).iter().all(|limit| limit.is_finite() && limit.abs() < f64::MAX) {
        notes.push(format!("The robot file gives no limits of the joint; {NO_LIMIT} stands for none."));
    }
    notes.extend(effect_notes(model));
    comment(&mut text, &notes);
    text.push_str("  <link name=\"base\"/>\n");
    body(&mut text, &link_name(joint), mass_kg, [0.0, 0.0], inertia_kg_m2);
    connect(&mut text, model, robot, 0, "base", &origin, kind, axis);
    transmission(&mut text, joint, None);
    text.push_str("</robot>\n");
    text
}

/// What stands for a limit that the robot file does not give.
const NO_LIMIT: f64 = 1e6;

fn limits(joint: &Joint) -> [f64; 3] {
    [joint.limits.position_low_rad, joint.limits.position_high_rad, joint.limits.speed_rad_s]
}

fn effect_notes(model: &Model) -> Vec<String> {
    if model.effects.is_empty() {
        return Vec::new();
    }
    let named: Vec<String> =
        model.effects.iter().map(|effect| format!("{} of joint {}", effect.name, effect.joint)).collect();
    vec![format!("URDF has no place for what the model has beyond this: {}.", named.join(", "))]
}

fn head(robot: &Robot) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<robot name=\"{}\" xmlns:drake=\"http://drake.mit.edu\">\n",
        escaped(&robot.name)
    )
}

fn comment(text: &mut String, notes: &[String]) {
    // A comment must not contain two hyphens in a row.
    let line = |note: &String| format!("    {}\n", note.replace("--", "- -"));
    let lines: String = notes.iter().map(line).collect();
    push(text, format!("  <!-- Made by {} from an identified model.\n{lines}  -->\n", crate::TOOL_VERSION));
}

fn link_name(joint: &Joint) -> String {
    format!("link_{}", joint.name)
}

fn joint_name(joint: &Joint) -> String {
    format!("joint_{}", joint.name)
}

fn body(text: &mut String, name: &str, mass_kg: f64, [x, y]: [f64; 2], inertia_kg_m2: f64) {
    push(
        text,
        format!(
            "  <link name=\"{name}\">\n    <inertial>\n      <origin xyz=\"{x:?} {y:?} 0\"/>\n      \
             <mass value=\"{mass_kg:?}\"/>\n      <inertia ixx=\"{inertia_kg_m2:?}\" ixy=\"0\" ixz=\"0\" \
             iyy=\"{inertia_kg_m2:?}\" iyz=\"0\" izz=\"{inertia_kg_m2:?}\"/>\n    </inertial>\n  </link>\n"
        ),
    );
}

/// The joint, with the motor's friction and limits as the joint feels them.
#[expect(clippy::too_many_arguments, reason = "each is one part of one XML element")]
fn connect(
    text: &mut String,
    model: &Model,
    robot: &Robot,
    index: usize,
    parent: &str,
    origin: &str,
    kind: &str,
    axis: &str,
) {
    let joint = &robot.joints[index];
    let ratio = joint.gear_ratio.abs();
    let damping = model.viscous_nm_s_per_rad[index] * ratio * ratio;
    let friction = model.coulomb_nm[index] * ratio;
    let effort = joint.torque_constant_nm_per_a * joint.current_limit_a * ratio;
    let [lower, upper, velocity] = limits(joint).map(|limit| limit.clamp(-NO_LIMIT, NO_LIMIT));
    push(
        text,
        format!(
            "  <joint name=\"{}\" type=\"{kind}\">\n    <parent link=\"{parent}\"/>\n    <child link=\"{}\"/>\n    \
             <origin {origin}/>\n    <axis xyz=\"{axis}\"/>\n    <limit lower=\"{lower:?}\" upper=\"{upper:?}\" \
             effort=\"{effort:?}\" velocity=\"{velocity:?}\"/>\n    <dynamics damping=\"{damping:?}\" \
             friction=\"{friction:?}\"/>\n  </joint>\n",
            joint_name(joint),
            link_name(joint)
        ),
    );
}

fn transmission(text: &mut String, joint: &Joint, rotor_inertia_kg_m2: Option<f64>) {
    let ratio = joint.gear_ratio;
    let rotor = rotor_inertia_kg_m2.map_or(String::new(), |inertia| {
        format!("      <drake:rotor_inertia value=\"{inertia:?}\"/>\n      <drake:gear_ratio value=\"{ratio:?}\"/>\n")
    });
    push(
        text,
        format!(
            "  <transmission name=\"transmission_{0}\">\n    <type>transmission_interface/SimpleTransmission</type>\n    \
             <joint name=\"{1}\">\n      <hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface>\n    \
             </joint>\n    <actuator name=\"motor_{0}\">\n      <mechanicalReduction>{ratio:?}</mechanicalReduction>\n\
             {rotor}    </actuator>\n  </transmission>\n",
            joint.name,
            joint_name(joint)
        ),
    );
}

fn push(text: &mut String, piece: String) {
    // Writing to a String cannot fail.
    let _ = text.write_str(&piece);
}

fn escaped(text: &str) -> String {
    crate::shown::line(text).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
