//! A motor's inertia that was found beyond what the arm leaves its motor: the simulation took less (or the least), so
//! that is what is told, without an error.

use super::findings::Finding;
use crate::effects::{MOTOR_INERTIA, MotorInertiaBeyond};
use crate::model::Model;
use crate::robot::Robot;

/// Both motors share what the arm leaves them, so that taking less of one makes room: this often at most.
const CORRECTIONS: usize = 100;

/// Corrects the effects of `model` and `findings`; gives a sentence for each.
pub fn told_as_taken(model: &mut Model, findings: &mut [Finding], robot: &Robot) -> Vec<String> {
    let beyond = |model: &Model| MotorInertiaBeyond::all(&model.effects, robot, model.f).unwrap_or_default();
    let first = beyond(model);
    for _ in 0..CORRECTIONS {
        let still = beyond(model);
        if still.is_empty() {
            break;
        }
        for MotorInertiaBeyond { entry, taken_kg_m2, .. } in still {
            model.effects[entry].parameters.insert(MOTOR_INERTIA.into(), taken_kg_m2);
        }
    }
    let told = |MotorInertiaBeyond { entry, wanted_kg_m2, taken_kg_m2 }| {
        let effect = &mut model.effects[entry];
        let taken_kg_m2 = effect.parameters.get(MOTOR_INERTIA).copied().unwrap_or(taken_kg_m2);
        effect.standard_error.remove(MOTOR_INERTIA);
        let finding = findings.iter_mut().find(|finding| finding.name == effect.name && finding.joint == effect.joint);
        if let Some(parameter) = finding.and_then(|finding| finding.parameters.get_mut(MOTOR_INERTIA)) {
            parameter.value = taken_kg_m2;
            parameter.standard_error = None;
        }
        let end = if taken_kg_m2 < wanted_kg_m2 { "most" } else { "least" };
        format!(
            "joint {}: {} fits best with {wanted_kg_m2:.2e} kg m² at the motor; {taken_kg_m2:.2e} is taken, the {end} that \
             this arm's f can have there: how its inertia is shared between motor and link remains open",
            effect.joint, effect.name
        )
    };
    first.into_iter().map(told).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::parse;
    use crate::explain::findings::FoundParameter;
    use crate::hidden_robot::HiddenRobot;

    #[test]
    fn a_motor_found_heavier_than_its_joint_is_told_as_the_most_it_can_be_and_without_an_error() {
        let robot = Robot::paper();
        let mut model = HiddenRobot::draw(&robot, 5).to_model(toml::Table::new());
        let heavy = "load-dependent-friction:joint=3,coefficient=0.1,motor_inertia_kg_m2=5e-3";
        let mut effect = parse(heavy).unwrap();
        effect.standard_error = [("coefficient".to_string(), 1e-3), (MOTOR_INERTIA.to_string(), 1e-7)].into();
        model.effects = vec![effect];
        let error = |name: &str| model.effects[0].standard_error.get(name).copied();
        let parameters = model.effects[0]
            .parameters
            .iter()
            .map(|(name, &value)| (name.clone(), FoundParameter { value, standard_error: error(name), unit: "" }));
        let mut findings = vec![Finding {
            name: "load-dependent-friction",
            joint: "3".into(),
            class: vec!["load-dependent-friction"],
            parameters: parameters.collect(),
            place: String::new(),
            delta_bic: 100.0,
        }];
        let sentences = told_as_taken(&mut model, &mut findings, &robot);
        let [sentence] = &sentences[..] else { panic!("{sentences:?}") };
        assert!(sentence.contains("5.00e-3") && sentence.contains("the most"), "{sentence}");
        let (told, kept) = (&findings[0].parameters[MOTOR_INERTIA], &findings[0].parameters["coefficient"]);
        let whole = model.f[0] / robot.joints[1].gear_ratio.powi(2);
        assert!(told.value < whole && told.standard_error.is_none(), "{told:?} of {whole}");
        assert_eq!((kept.value, kept.standard_error), (0.1, Some(1e-3)));
        assert_eq!(model.effects[0].parameters[MOTOR_INERTIA], told.value);
        assert_eq!(told_as_taken(&mut model, &mut findings, &robot), Vec::<String>::new());
    }
}
