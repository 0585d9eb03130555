//! The plot on the terminal.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, Paragraph};
use ratatui::{DefaultTerminal, Frame};

use super::super::wording::in_its_words;
use super::{Next, row::Row};

/// How much of the past is shown, in s.
const WINDOW_S: f64 = 30.0;
/// One colour a joint, both readable on light and dark ground.
const COLOURS: [Color; 2] = [Color::Cyan, Color::Magenta];
/// Least range of a plot: noise of one count or a few milliamperes should not fill it.
const LEAST_ERROR_COUNTS: f64 = 5.0;
const LEAST_CURRENT_A: f64 = 0.2;

/// The terminal, taken over until this is dropped.
pub struct Screen {
    terminal: DefaultTerminal,
    history: History,
}

impl Screen {
    pub fn open(address: String) -> io::Result<Self> {
        Ok(Self { terminal: ratatui::try_init()?, history: History { address, rows: VecDeque::new() } })
    }

    /// Shows one more row, and looks at the keyboard.
    pub fn show(&mut self, row: Row) -> io::Result<Next> {
        self.history.push(row);
        self.terminal.draw(|frame| self.history.draw(frame))?;
        while event::poll(Duration::ZERO)? {
            if let Event::Key(key) = event::read()? {
                let ctrl_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
                if ctrl_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                    return Ok(Next::Leave);
                }
            }
        }
        Ok(Next::Go)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

/// What is shown.
struct History {
    address: String,
    rows: VecDeque<Row>,
}

impl History {
    fn push(&mut self, row: Row) {
        let oldest_s = row.time_s - WINDOW_S;
        self.rows.push_back(row);
        while self.rows.front().is_some_and(|row| row.time_s < oldest_s) {
            self.rows.pop_front();
        }
    }

    fn draw(&self, frame: &mut Frame<'_>) {
        let Some(last) = self.rows.back() else { return };
        let [head, errors, currents] =
            Layout::vertical([Constraint::Length(5), Constraint::Fill(1), Constraint::Fill(1)]).areas(frame.area());
        let [p2, p3] = last.status.position_counts;
        let pose = if last.status.pose_known { "" } else { " since the start (pose not declared)" };
        let stop = if last.status.emergency_stop { "open: stop" } else { "closed" };
        let text = vec![
            Line::from(format!("{}   mode {}", self.address, last.mode())),
            Line::from(format!("counts {p2} {p3}{pose}   emergency stop {stop}")),
            Line::from(format!("limits acted: {}   deadlines missed: {}", last.limits(), last.missed_deadlines)),
            Line::from(last.traffic()),
            Line::from("q leaves"),
        ];
        frame.render_widget(Paragraph::new(text), head);
        let error = |row: &Row, joint: usize| f64::from(row.status.error_counts[joint]);
        self.draw_joints(frame, errors, "tracking error, counts", LEAST_ERROR_COUNTS, &error);
        let current = |row: &Row, joint: usize| f64::from(row.status.current_a[joint]);
        self.draw_joints(frame, currents, "measured current, A", LEAST_CURRENT_A, &current);
    }

    /// One value of both joints over time.
    fn draw_joints(
        &self,
        frame: &mut Frame<'_>,
        area: Rect,
        title: &str,
        least: f64,
        value: &dyn Fn(&Row, usize) -> f64,
    ) {
        let points =
            [0, 1].map(|joint| self.rows.iter().map(|row| (row.time_s, value(row, joint))).collect::<Vec<_>>());
        let largest = points.iter().flatten().fold(least, |largest, (_, value)| value.abs().max(largest));
        let end_s = self.rows.back().map_or(0.0, |row| row.time_s).max(WINDOW_S);
        let now = points.each_ref().map(|points| points.last().map_or(0.0, |(_, value)| *value));
        let datasets = (0..2)
            .map(|joint| {
                Dataset::default()
                    .name(format!("{}: {:.2}", in_its_words(&format!("joint {}", joint + 2)), now[joint]))
                    .marker(Marker::Braille)
                    .graph_type(GraphType::Line)
                    .style(Style::new().fg(COLOURS[joint]))
                    .data(&points[joint])
            })
            .collect();
        let times = [end_s - WINDOW_S, end_s];
        let chart = Chart::new(datasets)
            // The legend shows the numbers of now; by itself it would hide on a small terminal.
            .hidden_legend_constraints((Constraint::Ratio(1, 1), Constraint::Ratio(1, 1)))
            .block(Block::bordered().title(title))
            .x_axis(Axis::default().bounds(times).labels(times.map(|time_s| format!("{time_s:.0} s"))))
            .y_axis(
                Axis::default()
                    .bounds([-largest, largest])
                    .labels([-largest, 0.0, largest].map(|value| format!("{value:.1}"))),
            );
        frame.render_widget(chart, area);
    }
}

#[cfg(test)]
mod tests {
    use armid::client::Client;
    use armid::link::SimulatedBoard;
    use armid::robot::Robot;
    use ratatui::{Terminal, backend::TestBackend};

    use super::*;

    #[test]
    fn the_screen_shows_the_last_seconds_of_both_joints() {
        let mut client = Client::connect(Box::new(SimulatedBoard::hidden(&Robot::paper(), 1))).unwrap();
        let (status, info) = (client.status().unwrap(), client.info().clone());
        let mut history = History { address: "usb:A1".into(), rows: VecDeque::new() };
        for time_s in 0..100 {
            let mut row = Row::new(Duration::from_secs(time_s), status, &info);
            row.status.error_counts = [-(time_s as i32), 7];
            row.status.current_a = [1.25, -0.5];
            history.push(row);
        }
        assert_eq!(history.rows.len(), 31);
        let mut terminal = Terminal::new(TestBackend::new(100, 40)).unwrap();
        terminal.draw(|frame| history.draw(frame)).unwrap();
        let shown = terminal.backend().to_string();
        for part in
            ["usb:A1", "mode idle", "joint 2: -99.00", "joint 3: 7.00", "joint 2: 1.25", "-99.0", "69 s", "99 s"]
        {
            assert!(shown.contains(part), "no {part:?} in\n{shown}");
        }
    }
}
