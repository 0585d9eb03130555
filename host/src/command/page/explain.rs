//! The page of `explain`.

use armid::effects::BOTH_JOINTS;
use armid::explain::{Explanation, Verdict};
use armid::report::{self, Page, Provenance};
use armid::robot::Robot;

/// The page of an explanation.
pub fn page(robot: &Robot, explanation: &Explanation, provenance: &Provenance) -> Page {
    let mut sections = explanation.sections();
    sections.push(report::parameters(robot, "refitted", &report::of_model(robot, &explanation.model)));
    sections.push(provenance.section());
    Page {
        command: "explain".into(),
        title: robot.name.clone(),
        verdict: format!("Verdict: {}. {}", explanation.verdict.word(), in_words(explanation)),
        sections,
    }
}

/// The joint of an effect in words.
pub fn place(joint: &str) -> String {
    if joint == BOTH_JOINTS { "both joints".into() } else { format!("joint {joint}") }
}

/// The verdict in a sentence.
fn in_words(explanation: &Explanation) -> String {
    let named: Vec<String> =
        explanation.effects.iter().map(|effect| format!("{} ({})", effect.name, place(&effect.joint))).collect();
    match explanation.verdict {
        Verdict::Named => format!("The model lacks {}.", named.join(", ")),
        Verdict::None => "The model lacks nothing that these recordings show.".into(),
        Verdict::Unknown => "The model lacks something that is none of the known effects.".into(),
        Verdict::Partial => format!("The model lacks {} and something more.", named.join(", ")),
    }
}
