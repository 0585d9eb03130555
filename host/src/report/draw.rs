//! Pictures as SVG: on a page, where the style sheet colours them, or several on a sheet, as a file of their own.
//!
//! The text is left to the viewer's own sans-serif font, so nothing has to be installed where a picture is made.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::picture::{Band, Content, Ink, Intervals, Line, Map, Picture};

/// Width and height of a picture on a page, as the style sheet shows it at most.
const INLINE: (u32, u32) = (500, 270);

/// The SVG backend places everything on whole units; a page's picture has so many of them to a point of the screen.
const FINENESS: u32 = 3;

/// Text, frames and ticks. The style sheet names the same colours.
const TEXT: RGBColor = RGBColor(0, 0, 0);
/// Lines of the grid.
const GRID: RGBColor = RGBColor(221, 221, 221);

/// A picture that could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the picture \"{title}\" could not be drawn: {reason}")]
pub struct PictureError {
    title: String,
    reason: String,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// One picture without title and legend, transparent, for a page.
pub fn inline(picture: &Picture) -> Result<String, PictureError> {
    let mut svg = String::new();
    let drawn = {
        let area = SVGBackend::with_string(&mut svg, (INLINE.0 * FINENESS, INLINE.1 * FINENESS)).into_drawing_area();
        axes(&area, picture, FINENESS, false).and_then(|()| Ok(area.present()?))
    };
    finished(drawn, &picture.title, svg)
}

/// Pictures under one title, so many beside each other, each of `size` points: a file of its own.
pub fn sheet(title: &str, pictures: &[Picture], columns: usize, size: (u32, u32)) -> Result<String, PictureError> {
    const TITLE_HEIGHT: u32 = 40;
    let columns = columns.clamp(1, pictures.len().max(1));
    let rows = pictures.len().div_ceil(columns).max(1);
    let whole = (size.0 * columns as u32, size.1 * rows as u32 + TITLE_HEIGHT);
    let mut svg = String::new();
    let drawn = (|| -> Drawn {
        let area = SVGBackend::with_string(&mut svg, whole).into_drawing_area();
        area.fill(&WHITE)?;
        let area = area.titled(title, ("sans-serif", 22))?;
        for (panel, picture) in area.split_evenly((rows, columns)).iter().zip(pictures) {
            axes(panel, picture, 1, true)?;
        }
        Ok(area.present()?)
    })();
    finished(drawn, title, svg)
}

fn finished(drawn: Drawn, title: &str, svg: String) -> Result<String, PictureError> {
    drawn.map_err(|error| PictureError { title: title.into(), reason: error.to_string() })?;
    Ok(crate::shown::lines(&svg))
}

/// Draws one pair of axes with everything between them.
fn axes(area: &Area<'_>, picture: &Picture, scale: u32, stand_alone: bool) -> Drawn {
    let logarithmic = match &picture.content {
        Content::LogarithmicLines(_) => true,
        Content::Intervals(intervals) => intervals.logarithmic,
        Content::Lines(..) | Content::Points(..) | Content::Map(_) => false,
    };
    let Some([x, mut y]) = ranges(picture, logarithmic) else { return Ok(()) };
    if let Some(least) = picture.symmetric {
        let largest = y[0].abs().max(y[1].abs()).max(least);
        y = [-largest, largest];
    }
    let mut builder = ChartBuilder::on(area);
    let x_area = if picture.axes[0].is_empty() { 24 } else { 44 };
    // The last tick of the axis along stands half beside it.
    builder.margin(8 * scale).margin_right(20 * scale).x_label_area_size(x_area * scale).y_label_area_size(68 * scale);
    if stand_alone {
        builder.caption(&picture.title, ("sans-serif", 16 * scale));
    }
    let mut chart = builder.build_cartesian_2d(x[0]..x[1], y[0]..y[1])?;
    let text = |points: u32| ("sans-serif", points * scale).into_font().color(&TEXT);
    let power = |value: &f64| power_of_ten(*value);
    let [x_tick, y_tick] = [x, y].map(|[low, high]| {
        let digits = tick_digits(high - low);
        move |value: &f64| tick(*value, digits)
    });
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(scale))
        .axis_style(TEXT.stroke_width(scale))
        .set_all_tick_mark_size(4 * scale)
        .label_style(text(if stand_alone { 13 } else { 16 }))
        .axis_desc_style(text(if stand_alone { 14 } else { 17 }))
        .x_labels(7)
        .y_labels(6)
        .x_label_formatter(&x_tick)
        .y_label_formatter(&y_tick)
        .x_desc(picture.axes[0].as_str())
        .y_desc(picture.axes[1].as_str());
    if logarithmic {
        mesh.y_label_formatter(&power);
    }
    if matches!(picture.content, Content::Intervals(_)) {
        mesh.disable_x_mesh().x_labels(0);
    }
    mesh.draw()?;
    match &picture.content {
        Content::Lines(bands, lines) => {
            for band in bands {
                draw_band(&mut chart, band)?;
            }
            // A model that repeats it well would hide what was measured: that shows on both sides of the thinner line.
            let hidden = matches!(&lines[..], [Line { ink: Ink::Measured, .. }, .., Line { ink: Ink::Simulated, .. }]);
            for line in lines {
                let wide = hidden && line.ink == Ink::Measured;
                draw_line(&mut chart, line, if wide { 3 * scale } else { 5 * scale / 4 }, Some)?;
            }
        }
        Content::LogarithmicLines(lines) => {
            for line in lines {
                draw_line(&mut chart, line, 2 * scale, logarithm)?;
            }
        }
        Content::Points(points, lines) => {
            for line in lines {
                draw_line(&mut chart, line, 5 * scale / 4, Some)?;
            }
            for of in points {
                let style = colour(of.ink).filled();
                let finite = of.points.iter().filter(|point| point.0.is_finite() && point.1.is_finite());
                chart.draw_series(finite.map(|&point| Circle::new(point, 3 * scale, style)))?;
            }
        }
        Content::Intervals(intervals) => draw_intervals(area, &mut chart, intervals, scale)?,
        Content::Map(map) => draw_map(&mut chart, map)?,
    }
    let legend = picture.legend();
    if stand_alone && legend.len() > 1 {
        for key in legend {
            let style = colour(key.ink).stroke_width(2 * scale);
            let nothing = std::iter::empty::<(f64, f64)>();
            chart
                .draw_series(LineSeries::new(nothing, style))?
                .label(key.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18 * scale as i32, y)], style));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.8))
            .border_style(TEXT)
            .label_font(text(12))
            .draw()?;
    }
    Ok(())
}

fn colour(ink: Ink) -> RGBColor {
    let [red, green, blue] = ink.rgb();
    RGBColor(red, green, blue)
}

/// The logarithm to the base of ten of what has one.
fn logarithm(value: f64) -> Option<f64> {
    (value > 0.0).then(|| value.log10())
}

/// Digits after the point that tell the ticks of an axis of this length apart; none where they take an exponent.
fn tick_digits(length: f64) -> Option<usize> {
    let digits = (-(length / 8.0).log10()).ceil();
    (-5.0..=5.0).contains(&digits).then_some(digits.max(0.0) as usize)
}

/// A tick of a linear axis.
fn tick(value: f64, digits: Option<usize>) -> String {
    let text = digits.map_or_else(|| format!("{value:.1e}"), |digits| format!("{value:.digits$}"));
    // A zero that rounding has given a sign.
    if text.starts_with('-') && text.trim_start_matches(['-', '0', '.']).is_empty() { text[1..].into() } else { text }
}

/// A tick of a logarithmic axis.
fn power_of_ten(exponent: f64) -> String {
    let value = 10_f64.powf(exponent);
    let whole = (exponent - exponent.round()).abs() < 1e-6;
    match exponent.round() as i32 {
        0..=4 if whole => format!("{value:.0}"),
        -3..=-1 if whole => format!("{value:.*}", -exponent.round() as usize),
        power if whole => format!("1e{power}"),
        0..=2 => format!("{value:.1}"),
        _ => format!("{value:.1e}"),
    }
}

/// Abscissae and ordinates to show, the logarithm of them where the ordinate is logarithmic; nothing where there is
/// nothing to show.
fn ranges(picture: &Picture, logarithmic: bool) -> Option<[[f64; 2]; 2]> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    match &picture.content {
        Content::Lines(bands, lines) => {
            points.extend(lines.iter().flat_map(|line| &line.points));
            points.extend(bands.iter().flat_map(|band| &band.points).flat_map(|p| [(p[0], p[1]), (p[0], p[2])]));
        }
        Content::LogarithmicLines(lines) => points.extend(lines.iter().flat_map(|line| &line.points)),
        Content::Points(of, lines) => points.extend(of.iter().chain(lines).flat_map(|line| &line.points)),
        Content::Intervals(intervals) => {
            for (_, _, of) in &intervals.sources {
                points.extend(of.iter().flatten().flat_map(|i| [i.low, i.value, i.high]).map(|y| (0.5, y)));
            }
            points.retain(|point| point.1.is_finite());
            if !points.is_empty() {
                points.extend([(0.0, points[0].1), (intervals.names.len() as f64, points[0].1)]);
            }
        }
        Content::Map(map) => return Some([map.x, map.y]),
    }
    if logarithmic {
        points = points.into_iter().filter_map(|(x, y)| Some((x, logarithm(y)?))).collect();
    }
    points.retain(|point| point.0.is_finite() && point.1.is_finite());
    let first = *points.first()?;
    let range = |of: fn(&(f64, f64)) -> f64| {
        points.iter().fold([of(&first); 2], |[low, high], point| [low.min(of(point)), high.max(of(point))])
    };
    let (x, y) = (range(|point| point.0), range(|point| point.1));
    let wide = |[low, high]: [f64; 2]| if low < high { [low, high] } else { [low - 1.0, high + 1.0] };
    let ([x, y], air) = ([wide(x), wide(y)], 0.05);
    let span = y[1] - y[0];
    Some([x, [y[0] - air * span, y[1] + air * span]])
}

fn draw_line(chart: &mut Chart<'_>, line: &Line, width: u32, of: impl Fn(f64) -> Option<f64>) -> Drawn {
    let points = line.points.iter().filter_map(|&(x, y)| Some((x, of(y)?)));
    let points: Vec<(f64, f64)> = points.filter(|point| point.0.is_finite() && point.1.is_finite()).collect();
    chart.draw_series(LineSeries::new(points, colour(line.ink).stroke_width(width)))?;
    Ok(())
}

fn draw_band(chart: &mut Chart<'_>, band: &Band) -> Drawn {
    let points = || band.points.iter().filter(|point| point.iter().all(|value| value.is_finite()));
    let outline: Vec<(f64, f64)> =
        points().map(|point| (point[0], point[1])).chain(points().rev().map(|point| (point[0], point[2]))).collect();
    if outline.len() > 2 {
        chart.draw_series([Polygon::new(outline, colour(band.ink).mix(0.25).filled())])?;
    }
    Ok(())
}

fn draw_intervals(area: &Area<'_>, chart: &mut Chart<'_>, intervals: &Intervals, scale: u32) -> Drawn {
    let sources = intervals.sources.len() as f64;
    let shown = |value: f64| if intervals.logarithmic { logarithm(value) } else { Some(value) };
    let shown = |value: f64| shown(value).filter(|value| value.is_finite());
    for (place, (_, ink, of)) in intervals.sources.iter().enumerate() {
        let style = colour(*ink).stroke_width(2 * scale);
        for (index, interval) in of.iter().enumerate() {
            let Some(interval) = interval else { continue };
            let x = index as f64 + (place as f64 + 1.0) / (sources + 1.0);
            if let (Some(low), Some(high)) = (shown(interval.low), shown(interval.high)) {
                chart.draw_series([PathElement::new([(x, low), (x, high)], style)])?;
            }
            if let Some(value) = shown(interval.value) {
                chart.draw_series([Circle::new((x, value), 4 * scale, colour(*ink).filled())])?;
            }
        }
    }
    // The axis has no ticks of its own: each name stands in the middle of its intervals.
    let lowest = chart.y_range().start;
    let centred =
        TextStyle::from(("sans-serif", 16 * scale).into_font()).color(&TEXT).pos(Pos::new(HPos::Center, VPos::Top));
    let (left, top) = area.get_base_pixel();
    for (index, name) in intervals.names.iter().enumerate() {
        let (x, y) = chart.backend_coord(&(index as f64 + 0.5, lowest));
        area.draw(&Text::new(name.clone(), (x - left, y - top + 6 * scale as i32), centred.clone()))?;
    }
    Ok(())
}

fn draw_map(chart: &mut Chart<'_>, map: &Map) -> Drawn {
    let largest = map.largest();
    let rows = map.cells.len() as f64;
    for (row, cells) in map.cells.iter().enumerate() {
        let columns = cells.len() as f64;
        let at = |range: [f64; 2], share: f64| range[0] + share * (range[1] - range[0]);
        for (column, value) in cells.iter().enumerate() {
            let Some(value) = value.filter(|_| largest > 0.0) else { continue };
            // The ground shows through where there is little, so that a map reads on a light and on a dark one.
            let ink = if value < 0.0 { Ink::Simulated } else { Ink::Measured };
            let fill = colour(ink).mix(0.04 + 0.96 * value.abs() / largest).filled();
            let corners = [
                (at(map.x, column as f64 / columns), at(map.y, row as f64 / rows)),
                (at(map.x, (column as f64 + 1.0) / columns), at(map.y, (row as f64 + 1.0) / rows)),
            ];
            chart.draw_series([Rectangle::new(corners, fill)])?;
        }
    }
    Ok(())
}
