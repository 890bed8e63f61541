//! A long recording makes a page that can be sent by mail, and its numbers can be read back.

use qv_page::{Board, Choice, Line, Page, Panel, read};

/// Something between 0 and 1 that looks like chance.
fn chance(k: usize) -> f64 {
    let x = (k as f64 * 12.9898).sin() * 43_758.545_3;
    x - x.floor()
}

#[test]
fn twenty_seconds_of_twelve_joints_are_less_than_six_megabytes() {
    let time: Vec<f64> = (0..10_000).map(|k| 0.002 * k as f64 + 1e-4 * chance(k)).collect();
    let channels = [("position", 1.5, 1e-5), ("velocity", 20.0, 1e-3), ("torque", 40.0, 1e-3)];
    let series = ["measured", "before", "after"];
    let mut board = Board::new("time [s]");
    let seconds = board.column(&time, 1e-5);
    let value =
        |at: usize, k: usize, size: f64| size * (0.01 * k as f64 + at as f64).sin() + 0.01 * size * chance(at + k);
    for joint in 0..12 {
        for (channel, (name, size, step)) in channels.iter().enumerate() {
            let line = |(k, series): (usize, &&str)| {
                let values: Vec<f64> =
                    (0..time.len()).map(|i| value(100 * joint + 10 * channel + k, i, *size)).collect();
                Line::new(series, series, seconds, board.column(&values, *step))
            };
            let lines = series.iter().enumerate().map(line).collect();
            board.panels.push(Panel {
                title: (*name).into(),
                when: vec![vec![joint], vec![channel]],
                lines,
                ..Panel::default()
            });
        }
    }
    let options = |count: usize| (0..count).map(|k| k.to_string()).collect();
    let choice = |name: &str, count| Choice { name: name.into(), options: options(count), first: 0 };
    board.choices = vec![choice("joint", 12), choice("channel", 3)];
    let page = Page { title: "long", body: &board.to_card(), ..Page::default() }.to_html();
    assert!(page.len() < 6_000_000, "{} bytes", page.len());
    assert!(page.len() > 3_000_000, "{} bytes: something is not in it", page.len());
    let read = read::boards(&page);
    let panel = &read[0].panels[3 * 7 + 1];
    let (x, y) = read[0].points(&panel.lines[2]);
    for k in 0..time.len() {
        assert!((x[k] - time[k]).abs() < 0.51e-5 && (y[k] - value(712, k, 20.0)).abs() < 0.51e-3, "{k}");
    }
}
