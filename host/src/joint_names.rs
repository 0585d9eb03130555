//! The board's messages in the robot's own words: the board numbers its joints as the paper does, a robot file names them.

use crate::robot::Robot;

/// What the paper calls the joints, and the board.
const NUMBERED: [&str; 2] = ["joint 2", "joint 3"];

/// The names of a robot's joints; nothing for one that no board drives.
pub fn of(robot: &Robot) -> Option<[String; 2]> {
    match &robot.joints[..] {
        [first, second] => Some([first.name.clone(), second.name.clone()]),
        _ => None,
    }
}

/// A message of the board with these names of the joints in it.
pub fn in_message(message: &str, names: &[String; 2]) -> String {
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
    use super::in_message;

    #[test]
    fn joints_get_their_names() {
        let names = ["3", "elbow"].map(String::from);
        assert_eq!(in_message("joint 2 is 5 counts off", &names), "joint 3 is 5 counts off");
        assert_eq!(
            in_message("limits of joint 3, joint 2, joint 31", &names),
            "limits of joint elbow, joint 3, joint 31"
        );
        assert_eq!(in_message("no pose", &names), "no pose");
    }
}
