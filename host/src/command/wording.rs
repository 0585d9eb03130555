//! The board's messages in the robot's own words: the board numbers its joints as the paper does, a robot file names them.

use std::sync::OnceLock;

use armid::robot::Robot;

/// What the paper calls the joints, and the board.
const NUMBERED: [&str; 2] = ["joint 2", "joint 3"];

/// Names of the joints of this run's robot: a run has one.
static NAMES: OnceLock<[String; 2]> = OnceLock::new();

/// Says what the joints are called from now on.
pub fn of_robot(robot: &Robot) {
    if let [first, second] = &robot.joints[..] {
        NAMES.get_or_init(|| [first.name.clone(), second.name.clone()]);
    }
}

/// A message of the board with the names of the joints in it.
pub fn in_its_words(message: &str) -> String {
    match NAMES.get() {
        Some(names) => renamed(message, names),
        None => message.to_owned(),
    }
}

fn renamed(message: &str, names: &[String; 2]) -> String {
    let mut text = String::new();
    let mut rest = message;
    // In one pass, because a joint may have the other's number for its name.
    while let Some((at, joint)) = NUMBERED.iter().enumerate().filter_map(|(i, n)| Some((rest.find(n)?, i))).min() {
        let (before, after) = rest.split_at(at);
        let after = &after[NUMBERED[joint].len()..];
        let is_number = !after.starts_with(|next: char| next.is_ascii_digit());
        text += before;
        text += &if is_number { format!("joint {}", names[joint]) } else { NUMBERED[joint].to_owned() };
        rest = after;
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::renamed;

    #[test]
    fn joints_get_their_names() {
        let names = ["3", "elbow"].map(String::from);
        assert_eq!(renamed("joint 2 is 5 counts off", &names), "joint 3 is 5 counts off");
        assert_eq!(renamed("limits of joint 3, joint 2, joint 31", &names), "limits of joint elbow, joint 3, joint 31");
        assert_eq!(renamed("no pose", &names), "no pose");
    }
}
