//! Movements from files: Fourier series and points.
//!
//! ```toml
//! [fourier]
//! period_s = 5.0
//! repeats = 2
//! fade_s = 0.5
//! centre_rad = [-0.785, 0.785]
//! harmonic = [{ cosine_rad = [0.3, 0.2], sine_rad = [0.0, 0.1] }]
//! ```
//! ```toml
//! [points]
//! interval_s = 0.25
//! points_rad = [[0.0, 0.0], [-0.2, 0.3], [0.0, 0.0]]
//! ```

use std::f64::consts::FRAC_PI_4;
use std::path::Path;

use serde::{Deserialize, Serialize};
use shared::trajectory::{Fourier, Harmonic, MAX_HARMONICS, Paper, Points, Trajectory};
use toml::Spanned;

use crate::atomic;
use crate::file_error::{FileError, Problem};
use crate::toml_text::TomlText;

/// Longest time a file may name, in s: far beyond any movement, and safely a number of nanoseconds.
const LONGEST_S: f64 = 86_400.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTrajectory {
    fourier: Option<Spanned<RawFourier>>,
    points: Option<Spanned<RawPoints>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFourier {
    period_s: Spanned<f64>,
    #[serde(default = "once")]
    repeats: u32,
    #[serde(default)]
    fade_s: Option<Spanned<f64>>,
    centre_rad: [f32; 2],
    harmonic: Spanned<Vec<RawHarmonic>>,
}

fn once() -> u32 {
    1
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawHarmonic {
    #[serde(default)]
    cosine_rad: [f32; 2],
    #[serde(default)]
    sine_rad: [f32; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPoints {
    interval_s: Spanned<f64>,
    points_rad: Spanned<Vec<[f32; 2]>>,
}

/// The paper's movement of period `period_s`.
pub fn paper(period_s: f64) -> Option<Trajectory> {
    (period_s > 0.0 && period_s <= LONGEST_S)
        .then(|| Trajectory::Paper(Paper { period_ns: (period_s * 1e9).round() as u64 }))
}

/// What stands around the period in the name of the paper's movement.
const PAPER_NAME: [&str; 2] = ["paper, T = ", " s"];

/// The paper's movement in words, as manifests have it.
pub fn paper_name(period_s: f64) -> String {
    let [before, after] = PAPER_NAME;
    format!("{before}{period_s}{after}")
}

/// The movement that a manifest names: the paper's, or that of a file.
pub fn named(name: &str) -> Result<Trajectory, FileError> {
    let [before, after] = PAPER_NAME;
    let period = name.strip_prefix(before).and_then(|rest| rest.strip_suffix(after));
    let of_paper = period.and_then(|period_s| paper(period_s.parse().ok()?));
    of_paper.map_or_else(|| read(Path::new(name)), Ok)
}

/// Reads a movement. Limits are checked when it is loaded.
pub fn read(path: &Path) -> Result<Trajectory, FileError> {
    parse(&TomlText::read(path)?)
}

/// Writes a movement that [`read`] gives back to the bit, with `heading` as a comment. The paper's movement becomes
/// the Fourier series it is.
pub fn write(path: &Path, trajectory: &Trajectory, heading: &str) -> Result<(), FileError> {
    let text = TrajectoryText::of(trajectory);
    let text = toml::to_string(&text).map_err(|error| FileError::not_serializable(path, error))?;
    let heading: String = heading.lines().map(|line| format!("# {line}\n")).collect();
    atomic::write(path, (heading + &text).as_bytes())
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase")]
enum TrajectoryText {
    Fourier { period_s: f64, repeats: u32, fade_s: f64, centre_rad: [f64; 2], harmonic: Vec<HarmonicText> },
    Points { interval_s: f64, points_rad: Vec<[f64; 2]> },
}

#[derive(Serialize)]
struct HarmonicText {
    cosine_rad: [f64; 2],
    sine_rad: [f64; 2],
}

impl TrajectoryText {
    fn of(trajectory: &Trajectory) -> Self {
        // Through decimal text, so that an f32's 0.1 is written as 0.1 and not as 0.10000000149011612.
        let decimal = |value: f32| value.to_string().parse().unwrap_or(f64::from(value));
        let decimals = |pair: [f32; 2]| pair.map(decimal);
        let seconds = |duration_ns: u64| duration_ns as f64 * 1e-9;
        match trajectory {
            Trajectory::Paper(paper) => Self::Fourier {
                period_s: seconds(paper.period_ns),
                repeats: 1,
                fade_s: 0.0,
                centre_rad: [-FRAC_PI_4, FRAC_PI_4],
                harmonic: [[FRAC_PI_4, 0.0], [0.0, -FRAC_PI_4]]
                    .map(|cosine_rad| HarmonicText { cosine_rad, sine_rad: [0.0; 2] })
                    .into(),
            },
            Trajectory::Fourier(fourier) => Self::Fourier {
                period_s: seconds(fourier.period_ns),
                repeats: fourier.repeats,
                fade_s: seconds(fourier.fade_ns),
                centre_rad: decimals(fourier.centre_rad),
                harmonic: fourier
                    .harmonics
                    .iter()
                    .map(|harmonic| HarmonicText {
                        cosine_rad: decimals(harmonic.cosine_rad),
                        sine_rad: decimals(harmonic.sine_rad),
                    })
                    .collect(),
            },
            Trajectory::Points(points) => Self::Points {
                interval_s: seconds(points.interval_ns()),
                points_rad: points.points_rad().iter().copied().map(decimals).collect(),
            },
        }
    }
}

fn parse(text: &TomlText<'_>) -> Result<Trajectory, FileError> {
    let raw: RawTrajectory = text.parse()?;
    match (raw.fourier, raw.points) {
        (Some(fourier), None) => parse_fourier(text, fourier.get_ref()),
        (None, Some(points)) => parse_points(text, points.get_ref()),
        (Some(_), Some(points)) => Err(text.error(
            Some(points.span().start),
            Problem::Value { field: "[points]".into(), value: "there".into(), limit: "absent beside [fourier]".into() },
            "put the two movements into two files",
        )),
        (None, None) => {
            Err(text.error(None, Problem::Missing { field: "[fourier] or [points]".into() }, "describe a movement"))
        }
    }
}

fn nanoseconds(text: &TomlText<'_>, field: &str, seconds: &Spanned<f64>, least_s: f64) -> Result<u64, FileError> {
    let value = *seconds.get_ref();
    if (least_s..=LONGEST_S).contains(&value) {
        return Ok((value * 1e9).round() as u64);
    }
    let problem = Problem::Value {
        field: field.into(),
        value: value.to_string(),
        limit: format!("from {least_s} to {LONGEST_S} s"),
    };
    Err(text.error(Some(seconds.span().start), problem, "give it in seconds"))
}

fn parse_fourier(text: &TomlText<'_>, raw: &RawFourier) -> Result<Trajectory, FileError> {
    let harmonics = raw
        .harmonic
        .get_ref()
        .iter()
        .map(|raw| Harmonic { cosine_rad: raw.cosine_rad, sine_rad: raw.sine_rad })
        .collect::<Vec<_>>();
    let harmonics = heapless::Vec::from_slice(&harmonics).map_err(|_| {
        let problem = Problem::Value {
            field: "fourier.harmonic".into(),
            value: format!("a list of {}", harmonics.len()),
            limit: format!("a list of at most {MAX_HARMONICS}"),
        };
        text.error(Some(raw.harmonic.span().start), problem, "leave out the highest harmonics")
    })?;
    let fade_ns = raw.fade_s.as_ref().map_or(Ok(0), |fade| nanoseconds(text, "fourier.fade_s", fade, 0.0))?;
    Ok(Trajectory::Fourier(Fourier {
        period_ns: nanoseconds(text, "fourier.period_s", &raw.period_s, 1e-3)?,
        repeats: raw.repeats,
        fade_ns,
        centre_rad: raw.centre_rad,
        harmonics,
    }))
}

fn parse_points(text: &TomlText<'_>, raw: &RawPoints) -> Result<Trajectory, FileError> {
    let interval_ns = nanoseconds(text, "points.interval_s", &raw.interval_s, 1e-3)?;
    Points::new(interval_ns, raw.points_rad.get_ref()).map(Trajectory::Points).map_err(|error| {
        let problem = Problem::Value {
            field: "points.points_rad".into(),
            value: format!("a list of {} points", raw.points_rad.get_ref().len()),
            limit: format!("a movement ({error})"),
        };
        text.error(Some(raw.points_rad.span().start), problem, "correct the points")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Trajectory, String> {
        let text = TomlText::from_bytes(Path::new("move.toml"), text.as_bytes().to_vec()).unwrap();
        parse(&text).map_err(|error| error.to_string())
    }

    #[test]
    fn both_kinds_are_read() {
        let fourier = "[fourier]\nperiod_s = 5.0\nrepeats = 2\nfade_s = 0.5\ncentre_rad = [-0.785, 0.785]\n\
                       harmonic = [{ cosine_rad = [0.3, 0.2] }, { sine_rad = [0.0, 0.1] }]\n";
        assert_eq!(parsed(fourier).unwrap().duration_ns(), 10_000_000_000);
        let points = "[points]\ninterval_s = 0.25\npoints_rad = [[0.0, 0.0], [-0.2, 0.3], [0, 0]]\n";
        assert_eq!(parsed(points).unwrap().duration_ns(), 500_000_000);
        assert_eq!(paper(3.65).unwrap().record_periods(700_000), 5214);
        assert_eq!(paper(f64::NAN), None);
    }

    #[test]
    fn what_is_written_reads_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("move.toml");
        let harmonic = Harmonic { cosine_rad: [0.1, -1.0 / 3.0], sine_rad: [1e-7, 0.0] };
        let fourier = Fourier {
            period_ns: 3_649_999_999,
            repeats: 2,
            fade_ns: 500_000_001,
            centre_rad: [-0.785, 0.7],
            harmonics: [harmonic, harmonic].into_iter().collect(),
        };
        let points = Points::new(250_000_000, &[[0.0, 0.1], [-0.2, 1.0 / 3.0], [0.0, 0.1]]).unwrap();
        for trajectory in [Trajectory::Fourier(fourier), Trajectory::Points(points)] {
            write(&path, &trajectory, "two\nlines").unwrap();
            assert_eq!(read(&path).unwrap(), trajectory);
        }
        // The paper's movement becomes a series that is the same everywhere.
        let of_paper = paper(3.65).unwrap();
        write(&path, &of_paper, "").unwrap();
        let series = read(&path).unwrap();
        assert_eq!(series.duration_ns(), of_paper.duration_ns());
        for time_ns in (0..3_650_000_000).step_by(100_000_000) {
            let [a, b] = [&series, &of_paper].map(|movement| movement.reference::<f64>(time_ns).position_rad);
            assert!((a[0] - b[0]).abs() < 1e-7 && (a[1] - b[1]).abs() < 1e-7, "{time_ns}: {a:?} {b:?}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, parts) in [
            ("", "[fourier] or [points] is missing"),
            ("[points]\ninterval_s = 0\npoints_rad = [[0, 0], [0, 0]]", "move.toml:2: points.interval_s is 0"),
            ("[points]\ninterval_s = 1\npoints_rad = [[0, 0]]", "move.toml:3: points.points_rad is a list of 1 points"),
            ("[fourier]\nperiods_s = 1", "did you mean `period_s`?"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(parts), "{error}");
        }
    }
}
