//! The host's side of armid: files, links to a board, identification, and what a model lacks.
//!
//! ```text
//! robot, recording, model, trajectory_file   the files of the contract, read with every problem named
//! link ── client ── capture, journal         bytes to a board, requests and movements, movements to recordings
//! board_setup, compensation                  robot and model files in the protocol's terms
//! number_text                                numbers with their significant digits
//! shown                                      text from files as terminals and pages may show it
//! joint_names                                the board's messages with the robot file's names of the joints
//! firmware_image                             what may be flashed to a board
//! effects                                    what a real arm has beyond the model, by name
//! hidden_robot, hidden_effect                what a simulated board's robot really is
//! calibrate, identify ── identified_model    recordings → gains, recordings → model; `prior`: known beforehand
//! explain                                    recordings and a model → the effects that it lacks, by name
//! load                                       what a board tells of a load, and the same search on this computer
//! links                                      masses, centres and inertias that give an f
//! new_robot                                  a robot file from questions and answers
//! doctor                                     what on this computer is in the way of using a board
//! export                                     recordings and models in the formats of other programs
//! margins                                    how far computed torque is from instability on a model's arm
//! searchers                                  ways to search a box, beside the genetic algorithm
//! tracking                                   computed torque around a simulated arm, seen exactly
//! rerun                                      a recorded movement once more, on a simulated board around a model's arm
//! excite                                     the movement that determines the parameters best
//! report                                     pages of what was measured, found and done, with their pictures
//! explain_benchmark                          verdicts on recordings with hidden effects against the truth
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::print_stderr, reason = "eprintln! panics where stderr is closed or full")]
#![expect(clippy::result_large_err, reason = "an error ends the command; none is on a path that is often taken")]

mod atomic;
pub mod board_setup;
pub mod calibrate;
pub mod capture;
pub mod client;
pub mod compensation;
mod convex;
pub mod doctor;
mod edit_distance;
pub mod effects;
pub mod excite;
pub mod explain;
pub mod explain_benchmark;
pub mod export;
pub mod file_error;
pub mod firmware_image;
pub mod hidden_effect;
pub mod hidden_robot;
pub mod identified_model;
pub mod identify;
pub mod joint_names;
pub mod journal;
pub mod lanes;
pub mod link;
pub mod links;
pub mod load;
pub mod margins;
pub mod model;
pub mod new_robot;
pub mod number_text;
pub mod prior;
pub mod random;
pub mod recording;
pub mod report;
pub mod rerun;
pub mod robot;
pub mod searchers;
pub mod shown;
mod toml_text;
pub mod tracking;
pub mod trajectory_file;

/// Writes a file all at once: a reader sees the old file or the new one, never half of either.
pub use atomic::write as write_file;

/// Makes sure that a file can be written, before the work whose result goes there, and that no other program writes it
/// meanwhile.
pub use atomic::check as check_output;

/// Lets other programs write what [`check_output`] kept for this one; called before a program ends.
pub use atomic::release as release_outputs;

/// Files that programs left in a folder which were ended while they had a result to write: `NAME.armid.part`.
pub use atomic::abandoned as abandoned_outputs;

/// Whether something is there but neither a file nor a folder: a device, a named pipe, a terminal.
pub use atomic::is_stream;

/// Version of this tool, written into every file it makes.
pub const TOOL_VERSION: &str = concat!("armid ", env!("CARGO_PKG_VERSION"));
