//! What a picture shows, before it is drawn.

/// Points of a line at most: more are not seen.
const POINTS: usize = 1600;

/// What something is drawn in. The page's style sheet gives each its colour in light and dark; a file of its own has the
/// light ones. All can be told apart by everyone (Okabe & Ito 2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ink {
    /// What was measured: blue.
    Measured,
    /// What a model says: vermilion.
    Simulated,
    /// What is left between the two, or the third of several: green.
    Left,
    /// A bound: grey.
    Bound,
    /// One of several of a kind, counted from 0.
    Nth(usize),
}

/// The colours of several of a kind, as red, green and blue.
const SERIES: [[u8; 3]; 6] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233]];

/// The colour of bounds.
const GREY: [u8; 3] = [119, 119, 119];

impl Ink {
    /// Its place among the colours of several of a kind.
    fn index(self) -> Option<usize> {
        match self {
            Self::Measured => Some(0),
            Self::Simulated => Some(1),
            Self::Left => Some(2),
            Self::Bound => None,
            Self::Nth(index) => Some(index % SERIES.len()),
        }
    }

    /// Red, green and blue on a light ground.
    pub(super) fn rgb(self) -> [u8; 3] {
        self.index().map_or(GREY, |index| SERIES[index])
    }

    /// Its class in the style sheet.
    pub(super) fn class(self) -> String {
        self.index().map_or_else(|| "bound".into(), |index| format!("ink{index}"))
    }
}

/// A line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What it shows; empty for one that needs no words.
    pub name: String,
    /// What it is drawn in.
    pub ink: Ink,
    /// Its points.
    pub points: Vec<(f64, f64)>,
}

impl Line {
    /// A line named `name`.
    pub fn new(name: impl Into<String>, ink: Ink, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), ink, points }
    }
}

/// The area between two curves over the same abscissae.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// What it shows.
    pub name: String,
    /// What it is drawn in, thinly.
    pub ink: Ink,
    /// Abscissa, lower and upper ordinate.
    pub points: Vec<[f64; 3]>,
}

/// A value between two bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower bound.
    pub low: f64,
    /// The value.
    pub value: f64,
    /// Upper bound.
    pub high: f64,
}

/// Intervals of the same things from several sources, side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Intervals {
    /// What is shown.
    pub names: Vec<String>,
    /// Each source with its name, its ink, and one interval a name, where it has one.
    pub sources: Vec<(String, Ink, Vec<Option<Interval>>)>,
    /// Whether the ordinate is logarithmic; what is not positive is then left out.
    pub logarithmic: bool,
}

/// Mean values over a plane, by cells of equal size.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Least and greatest abscissa.
    pub x: [f64; 2],
    /// Least and greatest ordinate.
    pub y: [f64; 2],
    /// Rows from the least ordinate up, each from the least abscissa up; nothing where too little was measured.
    pub cells: Vec<Vec<Option<f64>>>,
}

impl Map {
    /// The largest value, without its sign.
    pub fn largest(&self) -> f64 {
        self.cells.iter().flatten().flatten().fold(0.0, |largest: f64, value| largest.max(value.abs()))
    }
}

/// What the axes of a picture hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Lines over bands.
    Lines(Vec<Band>, Vec<Line>),
    /// Lines on a logarithmic ordinate; what is not positive is left out.
    LogarithmicLines(Vec<Line>),
    /// Points that nothing joins, over lines.
    Points(Vec<Line>, Vec<Line>),
    /// Values with their bounds.
    Intervals(Intervals),
    /// A map, positive in one colour and negative in another, the stronger the larger.
    Map(Map),
}

/// A line of a legend.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Key {
    pub(super) name: String,
    pub(super) ink: Ink,
    pub(super) is_band: bool,
}

impl Key {
    /// Its classes in the style sheet.
    pub(super) fn class(&self) -> String {
        format!("key {}{}", self.ink.class(), if self.is_band { " band" } else { "" })
    }
}

/// One pair of axes and what is between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its title.
    pub title: String,
    /// What lies along and upward.
    pub axes: [String; 2],
    /// What it shows.
    pub content: Content,
    /// Where the ordinate is as long below zero as above: how long at least.
    pub symmetric: Option<f64>,
    /// What else to say below it.
    pub note: Option<String>,
}

impl Picture {
    /// Lines.
    pub fn lines(title: impl Into<String>, axes: [&str; 2], lines: Vec<Line>) -> Self {
        Self::of(title, axes, Content::Lines(Vec::new(), lines))
    }

    /// Any content.
    pub fn of(title: impl Into<String>, axes: [&str; 2], content: Content) -> Self {
        Self { title: title.into(), axes: axes.map(str::to_string), content, symmetric: None, note: None }
    }

    /// This with zero in the middle, and `least` above and below it at least.
    pub fn symmetric(mut self, least: f64) -> Self {
        self.symmetric = Some(least);
        self
    }

    /// This without names of what it shows, for a title that says it.
    pub fn unnamed(mut self) -> Self {
        match &mut self.content {
            Content::Lines(bands, lines) => {
                bands.iter_mut().for_each(|band| band.name.clear());
                lines.iter_mut().for_each(|line| line.name.clear());
            }
            Content::LogarithmicLines(lines) => lines.iter_mut().for_each(|line| line.name.clear()),
            Content::Points(points, lines) => points.iter_mut().chain(lines).for_each(|line| line.name.clear()),
            Content::Intervals(intervals) => intervals.sources.iter_mut().for_each(|source| source.0.clear()),
            Content::Map(_) => {}
        }
        self
    }

    /// This with a note below.
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.note = Some(note.into());
        self
    }

    /// What is drawn in which ink, every name once.
    pub(super) fn legend(&self) -> Vec<Key> {
        let mut legend: Vec<Key> = Vec::new();
        let key = |name: &String, ink: Ink| Key { name: name.clone(), ink, is_band: false };
        let all: Vec<Key> = match &self.content {
            Content::Lines(bands, lines) => lines
                .iter()
                .map(|line| key(&line.name, line.ink))
                .chain(bands.iter().map(|band| Key { is_band: true, ..key(&band.name, band.ink) }))
                .collect(),
            Content::LogarithmicLines(lines) => lines.iter().map(|line| key(&line.name, line.ink)).collect(),
            Content::Points(points, lines) => points.iter().chain(lines).map(|of| key(&of.name, of.ink)).collect(),
            Content::Intervals(intervals) => intervals.sources.iter().map(|(name, ink, _)| key(name, *ink)).collect(),
            Content::Map(_) => Vec::new(),
        };
        for key in all {
            if !key.name.is_empty() && legend.iter().all(|known| known.name != key.name) {
                legend.push(key);
            }
        }
        legend
    }
}

/// A signal as held between samples, without the samples that change nothing.
pub fn staircase(values: &[f64], period_s: f64) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (index, &value) in values.iter().enumerate() {
        let time_s = index as f64 * period_s;
        if let Some(&(_, previous)) = points.last() {
            if previous == value && index + 1 < values.len() {
                continue;
            }
            points.push((time_s, previous));
        }
        points.push((time_s, value));
    }
    points
}

/// As few points as the eye can tell from all of them: of each stretch the least and the greatest.
pub fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    if points.len() <= POINTS {
        return points;
    }
    let stretch = points.len().div_ceil(POINTS / 2).max(1);
    let ends = |part: &[(f64, f64)]| {
        let least = part.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
        let most = part.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
        let mut both: Vec<(f64, f64)> = least.into_iter().chain(most).collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both
    };
    points.chunks(stretch).flat_map(ends).collect()
}
