//! The pages that `--report` writes: which sections each command puts together.

pub mod calibrate;
pub mod compare;
pub mod demo;
pub mod excite;
pub mod explain;
pub mod identify;
pub mod load;
pub mod record;
pub mod track;

use std::path::{Path, PathBuf};

use armid::report::{Page, Provenance};
use clap::Args;

use super::CommandError;
use super::common::advise;
use super::outputs::{FileKind, check_apart, check_outputs};

/// Where a report page goes.
#[derive(Clone, Debug, Default, Args)]
pub struct ReportArguments {
    /// Report page to write: one HTML file with its pictures inside, which opens without a network
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl ReportArguments {
    /// Makes sure, before the work is done, that the page can be written and takes the place neither of what is read nor
    /// of the command's other `outputs`.
    pub fn check<'a, 'b>(
        &self,
        outputs: impl IntoIterator<Item = &'b Path>,
        inputs: impl IntoIterator<Item = &'a Path>,
    ) -> Result<(), CommandError> {
        self.report.as_deref().map_or(Ok(()), |page| check_page(page, outputs, inputs))
    }

    /// Writes the page, if one is wanted; `page` is made only then.
    pub fn write(&self, page: impl FnOnce() -> Result<Page, CommandError>) -> Result<(), CommandError> {
        self.report.as_deref().map_or(Ok(()), |path| write_page(path, &page()?))
    }
}

/// [`ReportArguments::check`] of a page at `page`.
pub fn check_page<'a, 'b>(
    page: &Path,
    outputs: impl IntoIterator<Item = &'b Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), CommandError> {
    check_apart(page, outputs, "the report page", "--report")?;
    check_outputs([(page, FileKind::Page)], inputs)
}

/// Writes `page` to `path` and says so.
pub fn write_page(path: &Path, page: &Page) -> Result<(), CommandError> {
    let html = page.to_html().map_err(|error| CommandError::Failed(error.to_string()))?;
    armid::write_file(path, html.as_bytes())?;
    advise(format!("report: {}", path.display()));
    Ok(())
}

/// The provenance of what this process does.
pub fn provenance() -> Provenance {
    Provenance::new(std::env::args_os().map(|word| word.to_string_lossy().into_owned()))
}

/// Numbers of the joints in one piece of text.
pub fn per_joint(values: &[f64], digits: usize) -> String {
    values.iter().map(|value| format!("{value:.digits$}")).collect::<Vec<_>>().join(" / ")
}
