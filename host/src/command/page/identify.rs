//! The page of `identify`, and what other commands show of an identification.

use armid::identify::{Experiment, Identification, Values};
use armid::recording::Recording;
use armid::report::{self, Cell, Page, Provenance, Row, Section, Table};
use armid::robot::Robot;

use super::super::CommandError;
use super::per_joint;

/// What an identification used and found.
pub struct Identified<'a> {
    pub robot: &'a Robot,
    /// The recordings as they were read.
    pub recordings: &'a [Recording],
    pub held_out: &'a [Recording],
    pub as_recorded: bool,
    pub found: &'a Identification,
    /// What else was asked, in words.
    pub remarks: Vec<String>,
}

impl Identified<'_> {
    /// The page.
    pub fn page(&self, provenance: &Provenance) -> Result<Page, CommandError> {
        let mut sections = self.sections()?;
        sections.push(provenance.section());
        Ok(Page { command: "identify".into(), title: self.robot.name.clone(), verdict: self.verdict(), sections })
    }

    fn verdict(&self) -> String {
        let found = self.found;
        let rounding = if self.robot.quantised { " (rounding alone leaves 0.29)" } else { "" };
        let lack =
            if found.lack_of_fit { " The model leaves far more than noise: something is missing from it." } else { "" };
        format!(
            "The model repeats the recordings to {} counts rms per joint; what it does not foresee is {} counts rms{rounding}.\
             {lack}",
            per_joint(&found.rms_counts, 3),
            per_joint(&found.innovation_rms_counts, 3)
        )
    }

    /// Everything but the provenance.
    pub fn sections(&self) -> Result<Vec<Section>, CommandError> {
        let Self { robot, found, .. } = self;
        let mut sections = vec![report::parameters(robot, "identified", &self.rows()), self.quality()];
        sections.extend(report::convergence(found));
        sections.extend(report::certainty(robot, found));
        let all: Vec<Recording> = self.recordings.iter().chain(self.held_out).cloned().collect();
        sections.extend(repeated(robot, &all, &found.values, self.as_recorded)?);
        Ok(sections)
    }

    fn rows(&self) -> Vec<Row> {
        let found = self.found;
        let unsought = super::super::identify::unsought(found);
        let row = |parameter| {
            let row = Row::of(self.robot, parameter, found.values.get(parameter), found.standard_error(parameter));
            let open = found.not_identifiable.contains(&parameter);
            Row { remark: if open { "not identifiable".into() } else { String::new() }, ..row }
        };
        found.free.iter().copied().chain(unsought).map(row).collect()
    }

    fn quality(&self) -> Section {
        let found = self.found;
        let mut table =
            Table::new(["recordings", "joint", "closed-loop difference, counts rms", "innovations, counts rms"]);
        let mut rows = |name: &str, differences: &[f64], innovations: &[f64]| {
            for (joint, (&difference, &innovation)) in self.robot.joints.iter().zip(differences.iter().zip(innovations))
            {
                table.rows.push(vec![
                    Cell::from(name),
                    Cell::from(joint.name.as_str()),
                    Cell::fixed(difference, 4),
                    Cell::fixed(innovation, 4),
                ]);
            }
        };
        rows("fitted", &found.rms_counts, &found.innovation_rms_counts);
        rows("held out", &found.held_out_rms_counts, &found.held_out_innovation_rms_counts);
        for (recording, left_out) in self.recordings.iter().zip(&found.left_out) {
            let name = format!("{}, foretold by the others", recording.path.display());
            rows(&name, &left_out.rms_counts, &left_out.innovation_rms_counts);
        }
        let repeats = found.repeats.iter().map(|repeats| {
            let names: Vec<String> =
                repeats.recordings.iter().map(|&index| self.recordings[index].path.display().to_string()).collect();
            format!(
                "{} repeat one movement: each fitted alone, they scatter by {:.2} of the standard errors",
                names.join(", "),
                repeats.ratio()
            )
        });
        let gap = found.force_gap_rms.iter().map(|gap| format!("Force gap {} N (N m) rms.", per_joint(gap, 4)));
        let samples = format!("{} samples, {} simulations.", found.samples, found.evaluations);
        let bounds = found.touched_bounds.iter().map(|bound| format!("At the edge of what a machine can be: {bound}."));
        Section::new("How well the model repeats the recordings")
            .table(table)
            .list(gap.chain(repeats).chain(bounds).chain([samples]))
            .list(found.findings.iter().cloned())
            .list(self.remarks.iter().cloned())
    }
}

/// Tracking errors and currents measured and simulated, and the residual maps, of recordings under the position loop.
pub fn repeated(
    robot: &Robot,
    recordings: &[Recording],
    values: &Values,
    as_recorded: bool,
) -> Result<Vec<Section>, CommandError> {
    let sound = |recording: &Recording| {
        if as_recorded { recording.clone() } else { recording.sound_part(robot).recording }
    };
    let sound: Vec<Recording> = recordings.iter().map(sound).collect();
    let experiment = Experiment::new(robot, &sound)?;
    let names: Vec<String> = sound.iter().map(|recording| recording.path.display().to_string()).collect();
    let [errors, currents] = report::repeated(&experiment, values, &sound);
    Ok(vec![errors, currents, report::residual_maps(&experiment, values, &names)])
}
