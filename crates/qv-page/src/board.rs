//! Plots that share one axis, from columns of numbers, with choices of what is shown.

use crate::pack::{PackedColumn, pack, unpack};
use serde::{Deserialize, Serialize};

/// A column of a board's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column(usize);

/// Something that a reader chooses, such as a joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// What is chosen: `joint`.
    pub name: String,
    /// From what.
    pub options: Vec<String>,
    /// Which of them at first.
    pub first: usize,
}

/// A named part of the axis that a reader can go to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stretch {
    /// Its name.
    pub name: String,
    /// From and to, in the unit of the axis.
    pub x: [f64; 2],
}

/// A part of the axis in a light colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Band {
    /// From and to, in the unit of the axis.
    pub x: [f64; 2],
    /// A colour of the style, see [`Line::tone`].
    pub tone: String,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Look {
    /// A line.
    Plain,
    /// A wide one that others are seen on: what was measured.
    Wide,
    /// A dashed one.
    Dashed,
    /// A line with its points.
    Dots,
    /// A bar wherever the number is above 0, in a row of its own; all lines of the panel are such.
    Bar,
}

/// One line of a panel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Its name; lines of one name are switched together.
    pub name: String,
    /// A colour of the style: `measured`, `before`, `after`, `floor`, `accent`, `good`, or `c0` to `c7`.
    pub tone: String,
    /// How it is drawn.
    pub look: Look,
    /// Where: known everywhere, and never falling.
    pub x: Column,
    /// How high; a gap breaks the line.
    pub y: Column,
    /// Taken from `y`, number by number; a difference needs no column of its own.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub minus: Option<Column>,
    /// What the difference is multiplied by before it is shown.
    pub factor: f64,
}

impl Line {
    /// A plain line of two columns as they are.
    pub fn new(name: &str, tone: &str, x: Column, y: Column) -> Self {
        Self { name: name.into(), tone: tone.into(), look: Look::Plain, x, y, minus: None, factor: 1.0 }
    }

    /// The same line, drawn in another way.
    pub fn looking(self, look: Look) -> Self {
        Self { look, ..self }
    }

    /// The same line minus a column, times a factor.
    pub fn minus(self, column: Column, factor: f64) -> Self {
        Self { minus: Some(column), factor, ..self }
    }

    /// The same line times a factor.
    pub fn times(self, factor: f64) -> Self {
        Self { factor, ..self }
    }
}

/// One plot.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// Unit of the vertical axis, may be empty.
    pub unit: String,
    /// For each choice the options with which this panel is shown; all of them where the list is empty or lacks.
    pub when: Vec<Vec<usize>>,
    /// Its lines.
    pub lines: Vec<Line>,
    /// Parts of the axis in colour.
    pub bands: Vec<Band>,
    /// Whether the vertical axis reaches to zero.
    pub zero: bool,
    /// Whether the vertical axis is one of logarithms.
    pub log: bool,
    /// Whether two such panels stand beside each other where there is room.
    pub half: bool,
}

/// Plots that share one axis, see the crate.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// Name and unit of the shared axis: `time [s]`.
    pub x: String,
    /// Boards of one name move together; empty for a board that moves alone.
    pub link: String,
    /// Whether the shared axis is one of logarithms.
    pub log: bool,
    /// Whether a click shows the page's own script a moment, by an event `qv-moment` of the document.
    pub reports: bool,
    /// What can be chosen.
    pub choices: Vec<Choice>,
    /// Parts of the axis to go to.
    pub stretches: Vec<Stretch>,
    /// Which of them is shown at first; all of the axis where there is none.
    pub begin: Option<usize>,
    /// The plots, from above.
    pub panels: Vec<Panel>,
    numbers: Vec<PackedColumn>,
}

impl Board {
    /// Without anything, over an axis of this name.
    pub fn new(x: &str) -> Self {
        Self { x: x.into(), ..Self::default() }
    }

    /// Keeps a column, rounded to `step` in its own unit (see [`crate::pack`]). A column that is there already is not kept twice.
    pub fn column(&mut self, values: &[f64], step: f64) -> Column {
        let packed = pack(values, step);
        let at = self.numbers.iter().position(|known| *known == packed).unwrap_or_else(|| {
            self.numbers.push(packed);
            self.numbers.len() - 1
        });
        Column(at)
    }

    /// The numbers of a column as a reader's screen gets them, a gap as NaN; empty for a column of another board.
    pub fn values(&self, column: Column) -> Vec<f64> {
        self.numbers.get(column.0).and_then(unpack).unwrap_or_default()
    }

    /// Places and heights of a line as they are drawn, a gap as NaN.
    pub fn points(&self, line: &Line) -> (Vec<f64>, Vec<f64>) {
        let (mut x, mut y) = (self.values(line.x), self.values(line.y));
        if let Some(column) = line.minus {
            let other = self.values(column);
            y.truncate(other.len());
            y.iter_mut().zip(other).for_each(|(y, other)| *y -= other);
        }
        y.iter_mut().for_each(|y| *y *= line.factor);
        x.truncate(y.len());
        y.truncate(x.len());
        (x, y)
    }

    /// Panels that are shown when nothing was chosen yet.
    pub fn at_first(&self) -> impl Iterator<Item = &Panel> {
        let chosen: Vec<usize> = self.choices.iter().map(|c| c.first).collect();
        let is_shown = move |when: &[Vec<usize>]| {
            when.iter().zip(&chosen).all(|(options, chosen)| options.is_empty() || options.contains(chosen))
        };
        self.panels.iter().filter(move |panel| is_shown(&panel.when))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::boards;

    fn board() -> Board {
        let mut board = Board::new("time [s]");
        let time = board.column(&[0.0, 0.1, 0.2, 0.3], 1e-4);
        let again = board.column(&[0.0, 0.1, 0.2, 0.3], 1e-4);
        assert_eq!(time, again);
        let measured = board.column(&[1.0, 2.0, f64::NAN, 4.0], 1e-3);
        let simulated = board.column(&[1.5, 2.25, 3.0, 4.0], 1e-3);
        board.choices =
            vec![Choice { name: "joint".into(), options: vec!["a</script><b>".into(), "b".into()], first: 1 }];
        for (joint, title) in ["first", "second"].iter().enumerate() {
            board.panels.push(Panel {
                title: (*title).into(),
                unit: "rad".into(),
                when: vec![vec![joint]],
                lines: vec![
                    Line::new("measured", "measured", time, measured).looking(Look::Wide),
                    Line::new("error", "before", time, simulated).minus(measured, 1e3),
                ],
                ..Panel::default()
            });
        }
        board
    }

    #[test]
    fn what_is_drawn_is_what_was_given() {
        let html = board().to_html();
        let read = boards(&html);
        assert_eq!(read.len(), 1);
        let (x, y) = read[0].points(&read[0].panels[0].lines[1]);
        assert!((x[3] - 0.3).abs() < 1e-9 && (y[0] - 500.0).abs() < 1e-6 && y[2].is_nan() && y[3] == 0.0);
        assert_eq!(read[0].choices[0].options[0], "a</script><b>");
    }

    #[test]
    fn no_name_ends_the_script_and_the_first_choice_is_drawn() {
        let html = board().to_html();
        assert_eq!(html.matches("</script>").count(), 1);
        assert!(!html.contains("<b>") && html.contains(">second") && !html.contains(">first"));
        assert!(html.matches("<svg").count() == 1 && !html.contains("NaN"), "{html}");
        assert!(Board::new("x").to_card().is_empty());
    }

    #[test]
    fn columns_of_another_board_or_of_unlike_lengths_are_no_disaster() {
        let (mut one, mut other) = (Board::new("x"), Board::new("x"));
        let x = one.column(&[1.0, 2.0, 3.0], 0.1);
        other.column(&[1.0], 0.1);
        let y = other.column(&[5.0, 9.0], 0.1);
        let short = one.column(&[5.0], 0.1);
        one.panels.push(Panel {
            lines: vec![Line::new("a", "c0", x, y), Line::new("b", "c1", x, x).minus(short, 1.0)],
            ..Panel::default()
        });
        let (x, y) = one.points(&one.panels[0].lines[1]);
        assert_eq!((x.len(), y), (1, vec![-4.0]));
        assert!(one.to_html().contains("board"));
    }
}
