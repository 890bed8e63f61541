//! A page with all parts in a browser.

use qv_page::parts::{self, Bars, Mood};
use qv_page::{Band, Board, Choice, Line, Look, Page, Panel, Stretch, Table};

fn board() -> Board {
    let time: Vec<f64> = (0..800).map(|k| 0.01 * f64::from(k)).collect();
    let mut board = Board::new("time [s]");
    let x = board.column(&time, 1e-4);
    for joint in 0..2 {
        let values =
            |late: f64| -> Vec<f64> { time.iter().map(|t| (3.0 * (t - late) + f64::from(joint)).sin()).collect() };
        let [measured, simulated] = [values(0.0), values(0.1)].map(|v| board.column(&v, 1e-4));
        board.panels.push(Panel {
            title: "position".into(),
            unit: "rad".into(),
            when: vec![vec![joint as usize]],
            lines: vec![
                Line::new("measured", "measured", x, measured).looking(Look::Wide),
                Line::new("simulated", "before", x, simulated),
                Line::new(
                    "a name that is longer than a telephone is wide, as of a joint of somebody else",
                    "c3",
                    x,
                    simulated,
                )
                .times(0.5),
            ],
            bands: vec![Band { x: [1.0, 2.0], tone: "accent".into() }],
            ..Panel::default()
        });
    }
    board.choices = vec![Choice { name: "joint".into(), options: vec!["hip".into(), "knee".into()], first: 0 }];
    board.stretches = vec![Stretch { name: "the first second".into(), x: [0.0, 1.0] }];
    board
}

#[test]
fn a_browser_shows_all_parts() {
    let moods = [
        (Mood::Good, "Explained"),
        (Mood::Fair, "Partly explained"),
        (Mood::Bad, "Unexplained"),
        (Mood::Plain, "Plain"),
    ];
    let answers = parts::answers(&[
        ("Cause", "<b>Friction</b>".into()),
        ("Next step", "Use <code>qv replay --params out/why/calibrated.toml</code>".into()),
    ]);
    let verdicts: String =
        moods.iter().map(|(mood, badge)| parts::verdict(*mood, badge, &format!("A sentence.{answers}"))).collect();
    let mut table =
        Table::with_left(&["joint", "what", "error [mrad]", "torque [N m]", "speed [rad/s]", "share"], &[1]);
    for k in 0..3 {
        table.row_with_bar(
            &[
                format!("FL_joint_{k}"),
                "words of some length".into(),
                "12.7".into(),
                "3.1".into(),
                "0.2".into(),
                "40 %".into(),
            ],
            2,
            0.4,
        );
    }
    let mut bars = Bars::new();
    bars.row("before", &parts::track(0.9, "before"), "38.2").row(
        "after",
        &parts::track_with_interval(0.4, [0.3, 0.5], "after"),
        "4.4",
    );
    let body = [
        verdicts,
        parts::notes(&["One message was lost.".into()]),
        parts::grid(
            300,
            &[parts::titled_card("Bars", &bars.to_html()), parts::card(&parts::list(&["One.".into(), "Two.".into()]))]
                .concat(),
        ),
        board().to_card(),
        parts::card(&format!("{}{}", table.to_html(), parts::key("measured", "recorded"))),
        parts::card("<details><summary>Details</summary><p class=\"soft small\">More.</p></details>"),
    ];
    crate::browser::check("parts", &Page { title: "All parts", body: &body.concat(), ..Page::default() }.to_html());
}
