//! `armid demo explain`: a robot changes after it was identified; what changed is found, named, added and compensated.

use armid::client::{Client, Pose};
use armid::compensation::board_model;
use armid::explain::{Explanation, Finding, Options, explain};
use armid::hidden_effect;
use armid::hidden_robot::HiddenRobot;
use armid::identify;
use armid::link::SimulatedBoard;
use armid::model::{Effect, Model};
use armid::recording::{Mode, Recording};
use armid::report::FileRole;
use armid::robot::Robot;
use clap::Args;
use serde_json::json;

use super::super::common::{advise, for_board, print, print_json};
use super::super::page;
use super::super::track::{self, Compared};
use super::super::{CommandError, identify as identify_command, progress};
use super::{Common, TRACKING_PERIOD_S, TRAINING_PERIODS_S, draw_tracking};

/// What is written into the output folder.
const FILES: [&str; 13] = [
    "robot.toml",
    "healthy1.csv",
    "healthy2.csv",
    "baseline.toml",
    "changed1.csv",
    "changed2.csv",
    "changed-check.csv",
    "extended.toml",
    "report.html",
    "ctc-healthy.csv",
    "ctc-baseline.csv",
    "ctc-extended.csv",
    "tracking.svg",
];

/// Period T of the movement that is kept back to judge by, in s.
const CHECK_PERIOD_S: f64 = 4.2;

const EXAMPLES: &str = "The effect is drawn from those of the library that computed torque can compensate: name, joint, size \
    and shape. What explains sees the recordings and the model of the healthy robot, nothing else; the truth is printed \
    last.

Examples:
  armid demo explain --seed 3
  armid demo explain --effect cogging:joint=2,amplitude_nm=0.05,order=4 --json";

/// Arguments of `demo explain`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ExplainDemo {
    /// Effect to hide instead of a drawn one, NAME:joint=JOINT,PARAMETER=VALUE,… (see simulate --help)
    #[arg(long, value_name = "EFFECT")]
    effect: Option<String>,
    #[command(flatten)]
    common: Common,
}

impl ExplainDemo {
    pub fn run(&self) -> Result<(), CommandError> {
        self.common.begin(&FILES)?;
        let robot = Robot::paper();
        robot.write(&self.common.out.join("robot.toml"))?;
        let healthy = HiddenRobot::draw(&robot, self.common.seed);
        let truth = match &self.effect {
            Some(text) => armid::effects::parse(text)?,
            None => hidden_effect::draw(&robot, self.common.seed),
        };
        let changed = healthy.clone().with_effects(std::slice::from_ref(&truth), &robot)?;

        advise("1/5 recording the healthy robot, and identifying it: the baseline");
        let mut client = self.board(&robot, healthy)?;
        let baseline = self.baseline(&robot, &mut client)?;
        client.upload(&board_model(&robot, &baseline)?)?;
        let healthy = self.common.movement(&mut client, &robot, TRACKING_PERIOD_S, Mode::Ctc, "ctc-healthy.csv")?;

        advise("2/5 something about the robot changes; recording it anew");
        let mut client = self.board(&robot, changed)?;
        let fitted = TRAINING_PERIODS_S
            .into_iter()
            .enumerate()
            .map(|(index, period_s)| {
                self.common.movement(&mut client, &robot, period_s, Mode::P, &format!("changed{}.csv", index + 1))
            })
            .collect::<Result<Vec<Recording>, CommandError>>()?;
        let check = self.common.movement(&mut client, &robot, CHECK_PERIOD_S, Mode::P, "changed-check.csv")?;

        advise("3/5 explaining what the baseline lacks");
        let explanation = self.explained(&robot, &fitted, &[check], &baseline)?;

        advise("4/5 tracking with the baseline");
        client.upload(&board_model(&robot, &baseline)?)?;
        let plain = self.common.movement(&mut client, &robot, TRACKING_PERIOD_S, Mode::Ctc, "ctc-baseline.csv")?;

        advise("5/5 tracking with the extended model");
        client.upload(&for_board(&robot, &explanation.model)?)?;
        let extended = self.common.movement(&mut client, &robot, TRACKING_PERIOD_S, Mode::Ctc, "ctc-extended.csv")?;

        let runs = [(&plain, "model of the healthy robot"), (&extended, "extended model")];
        draw_tracking(&self.common.out.join("tracking.svg"), &robot, &runs)?;
        let compared = [
            Compared { label: "healthy robot, its model", field: "ctc_healthy", recording: healthy },
            Compared { label: "changed robot, old model", field: "ctc_without_effects", recording: plain },
            Compared { label: "changed robot, extended model", field: "ctc", recording: extended },
        ];
        let recognised = recognised(&truth, &explanation);
        self.report(&robot, &truth, &explanation, &compared, recognised)?;
        self.common.report.write(|| {
            let provenance = page::provenance().seed(self.common.seed).robot(&robot);
            let provenance = page::demo::written(provenance, &self.common.out, &FILES);
            Ok(page::demo::explained(&robot, &truth, recognised, &explanation, &compared, provenance))
        })
    }

    /// A simulated board with `hidden` at its terminals, ready to move.
    fn board(&self, robot: &Robot, hidden: HiddenRobot) -> Result<Client, CommandError> {
        let mut client = Client::connect(Box::new(SimulatedBoard::new(robot, hidden, self.common.seed)))?;
        client.prepare(&armid::board_setup::configuration(robot)?, Pose::DefaultsTo([0.0; 2]), false)?;
        Ok(client)
    }

    /// The model of the robot as it was, with its standard errors.
    fn baseline(&self, robot: &Robot, client: &mut Client) -> Result<Model, CommandError> {
        let mut recordings = Vec::new();
        for (index, period_s) in TRAINING_PERIODS_S.into_iter().enumerate() {
            recordings.push(self.common.movement(
                client,
                robot,
                period_s,
                Mode::P,
                &format!("healthy{}.csv", index + 1),
            )?);
        }
        let options = identify::Options { seed: self.common.seed, ..identify::Options::default() };
        let found = identify_command::with_progress(robot, &recordings, &[], &options)?;
        let baseline = identify_command::to_model(robot, &recordings, &found, &options);
        baseline.write(&self.common.out.join("baseline.toml"))?;
        Ok(baseline)
    }

    /// All that is known here of the changed robot is in its recordings.
    fn explained(
        &self,
        robot: &Robot,
        fitted: &[Recording],
        check: &[Recording],
        baseline: &Model,
    ) -> Result<Explanation, CommandError> {
        let bar = progress::bar("explain", 0);
        let options = Options { seed: self.common.seed, design_next: false, kept_thresholds: None };
        let explanation = explain(robot, fitted, check, Some(baseline), &options, &|stage| {
            bar.set_message(stage);
            bar.tick();
        })?;
        bar.finish_and_clear();
        explanation.model.write(&self.common.out.join("extended.toml"))?;
        let provenance = page::provenance().seed(self.common.seed).robot(robot);
        let provenance = provenance.recordings(FileRole::Read, fitted.iter().chain(check));
        page::write_page(&self.common.out.join("report.html"), &page::explain::page(robot, &explanation, &provenance))?;
        Ok(explanation)
    }

    fn report(
        &self,
        robot: &Robot,
        truth: &Effect,
        explanation: &Explanation,
        compared: &[Compared],
        recognised: &str,
    ) -> Result<(), CommandError> {
        if self.common.json {
            let mut object = track::to_json(robot, compared);
            object["seed"] = json!(self.common.seed);
            object["explanation"] = explanation.to_json();
            object["sentences"] = json!(explanation.sentences);
            object["truth"] = json!(truth);
            object["truth_named"] = json!(recognised == NAMED);
            object["truth_in_class"] = json!(recognised != NOT_NAMED);
            object["out"] = json!(self.common.out);
            return print_json(&object);
        }
        let parameters: Vec<String> =
            truth.parameters.iter().map(|(name, value)| format!("{name} = {value:.4e}")).collect();
        let whose =
            if truth.joint == armid::effects::BOTH_JOINTS { "arm".into() } else { format!("joint {}", truth.joint) };
        print(format!(
            "\nWhat the baseline lacks (verdict: {})\n{}\n\nComputed torque on the paper's movement, T = {} s\n{}\n\nThe \
             truth (seed {}): {whose}: {} ({}): {}\n\nFiles in {}: {}",
            explanation.verdict.word(),
            explanation.sentences.join("\n"),
            TRACKING_PERIOD_S,
            track::table(robot, compared),
            self.common.seed,
            truth.name,
            parameters.join(", "),
            recognised,
            self.common.out.display(),
            FILES.join(", ")
        ))
    }
}

/// The effect hidden was named.
const NAMED: &str = "named";
/// It is in the class of one that was named.
const IN_CLASS: &str = "in the class named";
/// It is not.
const NOT_NAMED: &str = "not named";

/// How far the truth was recognised, on its own joint.
fn recognised(truth: &Effect, explanation: &Explanation) -> &'static str {
    let same_joint = |finding: &&Finding| finding.joint == truth.joint;
    let mut found = explanation.effects.iter().filter(same_joint);
    if found.clone().any(|finding| finding.name == truth.name) {
        NAMED
    } else if found.any(|finding| finding.class.contains(&truth.name.as_str())) {
        IN_CLASS
    } else {
        NOT_NAMED
    }
}
