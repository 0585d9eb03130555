//! `armid man`: manual pages and option tables, both made from the parser.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Arg, ArgAction, Args, Command, CommandFactory as _};
use clap_mangen::Man;
use serde_json::json;

use super::common::{print, print_json};
use super::{Arguments, CommandError};

const EXAMPLES: &str = "Examples:
  armid man --out ~/.local/share/man/man1           then: man armid, man armid-identify
  armid man --tables                                every command's options, as Markdown";

/// Arguments of `man`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Manual {
    /// Folder to write one manual page a command to
    #[arg(long, value_name = "FOLDER", required_unless_present = "tables")]
    out: Option<PathBuf>,
    /// Print tables of every command's options in Markdown instead
    #[arg(long, conflicts_with = "out")]
    tables: bool,
    /// Print one JSON object saying which pages were written
    #[arg(long, requires = "out")]
    json: bool,
}

impl Manual {
    pub fn run(&self) -> Result<(), CommandError> {
        let mut armid = Arguments::command().disable_help_subcommand(true);
        armid.build();
        let commands = commands(&armid);
        let Some(folder) = &self.out else { return print(tables(&commands)) };
        let mut pages = Vec::new();
        for command in commands {
            let page = Man::new(command.clone());
            let mut text = Vec::new();
            page.render(&mut text).map_err(CommandError::Output)?;
            let path = folder.join(page.get_filename());
            armid::write_file(&path, &text)?;
            pages.push(path);
        }
        if self.json { print_json(&json!({"pages": pages})) } else { print(format!("{} pages", pages.len())) }
    }
}

/// A command and all below it, in the order of `--help`.
fn commands(command: &Command) -> Vec<&Command> {
    let below = command.get_subcommands().filter(|command| !command.is_hide_set());
    std::iter::once(command).chain(below.flat_map(commands)).collect()
}

/// Tables of the options of `commands`.
fn tables(commands: &[&Command]) -> String {
    let mut text = String::from("# Options of every command\n\nMade from the parser by `armid man --tables`.\n");
    for command in commands {
        let name = command.get_display_name().unwrap_or(command.get_name()).replace('-', " ");
        let name = command.get_bin_name().map_or(name, String::from);
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        // Writing to a String cannot fail.
        let _ = write!(text, "\n## `{name}`\n\n{about}\n");
        let mut arguments = command.get_arguments().filter(|argument| !argument.is_hide_set()).filter(|argument| {
            // Every command has these.
            !matches!(argument.get_id().as_str(), "help" | "version")
        });
        let rows: String = arguments.by_ref().map(row).collect();
        if !rows.is_empty() {
            let _ = write!(text, "\n| argument | default | meaning |\n|---|---|---|\n{rows}");
        }
    }
    text
}

fn row(argument: &Arg) -> String {
    let takes_value = matches!(argument.get_action(), ArgAction::Set | ArgAction::Append);
    let value: Vec<String> = argument
        .get_value_names()
        .map(|names| names.iter().map(ToString::to_string).collect())
        .unwrap_or_else(|| vec![argument.get_id().to_string().to_uppercase()]);
    let value = value.join(" ");
    let name = match (argument.get_long(), takes_value) {
        (Some(long), true) => format!("`--{long} {value}`"),
        (Some(long), false) => format!("`--{long}`"),
        (None, _) => format!("`{value}`"),
    };
    // A flag's default is that it is not given.
    let defaults = if takes_value { argument.get_default_values() } else { &[] };
    let default: Vec<String> = defaults.iter().map(|value| format!("`{}`", value.to_string_lossy())).collect();
    let mut meaning = argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default();
    let choices: Vec<String> = argument
        .get_possible_values()
        .iter()
        .filter(|value| !value.is_hide_set())
        .map(|value| match value.get_help() {
            Some(help) => format!("`{}`: {help}", value.get_name()),
            None => format!("`{}`", value.get_name()),
        })
        .collect();
    if takes_value && !choices.is_empty() {
        let _ = write!(meaning, " ({})", choices.join("; "));
    }
    if let Some(variable) = argument.get_env() {
        let _ = write!(meaning, " (environment: `{}`)", variable.to_string_lossy());
    }
    let cell = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|");
    format!("| {} | {} | {} |\n", cell(name), cell(default.join(" ")), cell(meaning))
}
