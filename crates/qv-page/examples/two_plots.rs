//! Writes a page with two plots of two made-up joints, which zoom together: `cargo run -p quadverse-page --example two_plots FILE.html`.

use qv_page::{Board, Choice, Line, Look, Page, Panel, Stretch, Table, fixed, parts};

fn main() -> std::io::Result<()> {
    let time: Vec<f64> = (0..5000).map(|k| 0.002 * f64::from(k)).collect();
    let angle = |late: f64, joint: usize| -> Vec<f64> {
        let at = |t: &f64| 0.3 * (6.0 * (t - late) + joint as f64).sin();
        time.iter().map(at).collect()
    };
    let names = ["hip", "knee"];
    let mut board = Board::new("time [s]");
    let seconds = board.column(&time, 1e-5);
    for joint in 0..names.len() {
        let (mut robot, simulated) = (angle(0.01, joint), angle(0.0, joint));
        // Nothing was recorded for a while: the line breaks.
        robot[2000..2200].fill(f64::NAN);
        let [robot, simulated] = [robot, simulated].map(|values| board.column(&values, 1e-5));
        let when = vec![vec![joint]];
        let measured = Line::new("measured", "measured", seconds, robot).looking(Look::Wide);
        let line = Line::new("simulated", "before", seconds, simulated);
        let error = line.clone().minus(robot, 1e3);
        board.panels.push(Panel {
            title: "position".into(),
            unit: "rad".into(),
            when: when.clone(),
            lines: vec![measured, line],
            ..Panel::default()
        });
        board.panels.push(Panel {
            title: "simulated − measured".into(),
            unit: "mrad".into(),
            when,
            lines: vec![error],
            zero: true,
            ..Panel::default()
        });
    }
    board.choices = vec![Choice { name: "joint".into(), options: names.map(String::from).to_vec(), first: 0 }];
    board.stretches = vec![Stretch { name: "the gap".into(), x: [3.9, 4.5] }];
    let mut table = Table::new(&["joint", "error [mrad]"]);
    names.iter().for_each(|name| _ = table.row(&[(*name).to_string(), fixed(12.7, 1)]));
    let verdict = parts::verdict(parts::Mood::Fair, "Two joints", "The robot is 10 ms behind.");
    let body = [verdict, board.to_card(), parts::card(&table.to_html())].concat();
    let page = Page { title: "Two joints", body: &body, ..Page::default() }.to_html();
    let file = std::env::args().nth(1).unwrap_or_else(|| "two_plots.html".into());
    std::fs::write(&file, &page)?;
    println!("{file}: {} kB", page.len() / 1000);
    Ok(())
}
