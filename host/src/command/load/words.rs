//! What is told of a load in words, and what to do where none is found or one is doubtful.

use armid::load::Told;
use armid::number_text::significant;
use armid::robot::Robot;
use shared::load::{LoadEstimate, LoadNews, LoadSettings, Rejected, Waiting};

/// The load in use, in one line.
pub fn active(found: &LoadEstimate) -> String {
    format!("now active: {} kg", with_error(found.mass_kg, found.standard_error_kg))
}

/// A value and its standard error to the same digit: hundredths, or as fine as two digits of the error need.
pub fn with_error(value: f32, error: f32) -> String {
    let first = if error > 0.0 { -f64::from(error).log10().floor() } else { 2.0 };
    // Two digits say nothing of an error of grams.
    let digits = if error >= 0.01 { 2 } else { (first + 1.0).clamp(3.0, 9.0) as usize };
    format!("{value:.digits$} ± {error:.digits$}")
}

/// What is told of a load in the gripper of `robot`, in words.
pub fn sentence(robot: &Robot, news: &LoadNews) -> String {
    match news {
        LoadNews::Waiting(Waiting::Slow { joint }) => {
            let name = robot.joints.get(usize::from(*joint)).map_or("?", |joint| &joint.name);
            format!("waiting: joint {name} stands or is about to turn, and its friction hides the load")
        }
        LoadNews::Waiting(Waiting::RowsLost) => "waiting: rows were lost on the way to the identification".into(),
        LoadNews::Collecting => "collecting rows".into(),
        LoadNews::Searching => "searching for the load".into(),
        LoadNews::Learned { noise_ratio } => format!(
            "the empty arm has shown its model's errors (rows left {noise_ratio:.1} times the noise): take up the load"
        ),
        LoadNews::Found(found) => active(found),
        LoadNews::Rejected(why, found) => format!(
            "not used: {} kg, because {}; collecting again",
            with_error(found.mass_kg, found.standard_error_kg),
            reason(*why)
        ),
        LoadNews::Changed { by_kg, assumed_kg } => {
            format!(
                "the load has changed, by {by_kg:+.2} kg or more: assuming {assumed_kg:.2} kg, and identifying anew"
            )
        }
    }
}

fn reason(why: Rejected) -> &'static str {
    match why {
        Rejected::TooHeavy => "the rows want more than the largest load (--maximum-kg)",
        Rejected::Negative => {
            "the rows want less than no load: the model of the empty arm is wrong, or the load is not held where --grasp says"
        }
        Rejected::Uncertain => "it is known too poorly: the movement is too slow, or the model too uncertain",
        Rejected::OutOfReach => "its centre is out of reach",
        Rejected::Inconsistent => {
            "the rows are not of one arm with one such load: it changed among them, is not held where --grasp says, or is \
             heavier than --maximum-kg; or the model is wrong"
        }
        Rejected::NotFinite => "it is not a number",
    }
}

/// Whether a mass stands at the largest there may be: the rows may want more.
fn is_at_limit(found: &LoadEstimate, settings: &LoadSettings) -> bool {
    found.mass_kg >= 0.999 * settings.maximum_kg
}

/// How to have the rows tell where the load is held.
fn tell_the_centre(settings: &LoadSettings) -> String {
    let [x, y] = settings.centre_m.map(f64::from);
    let error_m = significant((0.5 * x.hypot(y)).max(0.02), 1);
    format!("let the rows tell its centre: --collect 1 --centre-error {error_m}")
}

/// Why nothing is active at the end of a movement, and what to do about it.
pub fn why_not(robot: &Robot, settings: &LoadSettings, told: &[Told], of_file: bool) -> String {
    let Some(last) = told.last() else {
        return "no load is active at the end of the movement, and the identification said nothing".into();
    };
    // What was rejected since the load was last another.
    let since = told.iter().rposition(|told| matches!(told.news, LoadNews::Changed { .. })).map_or(0, |at| at + 1);
    let rejected: Vec<(Rejected, LoadEstimate)> = told[since..]
        .iter()
        .filter_map(|told| match told.news {
            LoadNews::Rejected(why, found) => Some((why, found)),
            _ => None,
        })
        .collect();
    let Some((why, found)) = rejected.last() else {
        let remedy = match last.news {
            LoadNews::Waiting(_) | LoadNews::Collecting | LoadNews::Searching if of_file => {
                "; a longer movement (more repeats in its file) gives it time"
            }
            LoadNews::Waiting(_) | LoadNews::Collecting | LoadNews::Searching => {
                "; a longer movement (--period) gives it time"
            }
            _ => "",
        };
        return format!("no load is active at the end of the movement; last: {}{remedy}", sentence(robot, &last.news));
    };
    format!(
        "no load is active at the end of the movement: {} {} not used, the last, {} kg, because {}; {}",
        rejected.len(),
        if rejected.len() == 1 { "result was" } else { "results were" },
        with_error(found.mass_kg, found.standard_error_kg),
        reason(*why),
        remedy(&rejected, settings)
    )
}

/// What to do about results that were rejected.
fn remedy(rejected: &[(Rejected, LoadEstimate)], settings: &LoadSettings) -> String {
    let heavy = rejected.iter().filter(|(why, found)| *why == Rejected::TooHeavy || is_at_limit(found, settings));
    if 2 * heavy.count() > rejected.len() {
        return format!(
            "if the gripper holds more than {} kg, give a larger --maximum-kg (or maximum_load_kg of [gripper]); if it does \
             not, the load is held farther out than --grasp (or grasp_m) says: {}",
            settings.maximum_kg,
            tell_the_centre(settings)
        );
    }
    let uncertain = rejected.iter().filter(|(why, _)| *why == Rejected::Uncertain);
    if 2 * uncertain.count() > rejected.len() {
        return "a faster movement, more rows (--collect) or a model from better recordings tell more".into();
    }
    let [x, y] = settings.centre_m;
    format!(
        "probably the load is not held at {x},{y} m, where --grasp (or grasp_m of [gripper]) says: {}; or identify the empty \
         arm again",
        tell_the_centre(settings)
    )
}

/// Changes of a load that nobody wonders about: taken up, and with the difference from the empty arm set down again.
fn expected_changes(settings: &LoadSettings) -> usize {
    if settings.differential { 2 } else { 1 }
}

/// What makes a result doubtful, with what to do.
pub fn doubts(found: &LoadEstimate, settings: &LoadSettings, changes: usize) -> Vec<String> {
    let mut doubts = Vec::new();
    if is_at_limit(found, settings) {
        doubts.push(format!(
            "{} kg is the largest load there may be: if the gripper holds more, give a larger --maximum-kg (or \
             maximum_load_kg of [gripper])",
            settings.maximum_kg
        ));
    }
    let prior_m = settings.centre_standard_error_m;
    let [x, y] = [0, 1].map(|axis: usize| found.centre_m[axis] - settings.centre_m[axis]);
    if prior_m > 0.0 && x.abs().max(y.abs()) > 2.0 * prior_m {
        doubts.push(format!(
            "the load's centre is {:.3} m from {},{} m, where --grasp (or grasp_m of [gripper]) says: more than twice the {} m \
             of --centre-error; correct the grasp, or give a larger --centre-error",
            x.hypot(y),
            settings.centre_m[0],
            settings.centre_m[1],
            prior_m
        ));
    }
    if prior_m == 0.0 && changes > expected_changes(settings) {
        doubts.push(format!(
            "the load has changed {changes} times: if it has not, it is not held where --grasp (or grasp_m of [gripper]) says, \
             or the model is wrong; {}",
            tell_the_centre(settings)
        ));
    }
    doubts
}

#[cfg(test)]
mod tests {
    use super::with_error;

    #[test]
    fn a_load_of_a_small_robot_has_its_digits() {
        assert_eq!(with_error(1.7234, 0.031), "1.72 ± 0.03");
        assert_eq!(with_error(0.3, 0.000_042), "0.300000 ± 0.000042");
        assert_eq!(with_error(0.3, 0.0), "0.300 ± 0.000");
    }
}
