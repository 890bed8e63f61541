use qv_gap::columns::Columns;
use qv_gap::problem::{Cut, Problem};
use qv_gap::study::{Effort, Study};
use qv_gap::library;
use std::fs::File;
use std::time::Instant;
fn main() {
    for path in std::env::args().skip(1) {
        let f = File::open(&path).unwrap();
        let mapping = qv_go2::wire::mapping(None);
        let files = vec![qv_replay::BagFile { name: path.clone(), source: f }];
        let run = qv_replay::read_bag(files, &mapping).unwrap();
        let model = qv_sim::Model::from_urdf(&qv_go2::model::urdf(), &qv_sim::ModelOptions { base: qv_sim::BaseKind::Floating, armature: qv_go2::model::ARMATURE, mesh_vertices: None }).unwrap();
        let terrain = qv_sim::Terrain::plane();
        let t = Instant::now();
        let problem = Problem::new(&run, &model, &terrain, &[], Cut { window: std::env::var("W").map_or(0.3, |w| w.parse().unwrap()), most: std::env::var("M").map_or(72, |w| w.parse().unwrap()), ..Cut::default() }).unwrap();
        let columns = Columns::new(&problem, &run, &library::built_in()).unwrap();
        let study = Study::new(problem, columns, &run, &Effort::default()).unwrap();
        println!("{path}: {} windows, {} columns ({} tolerated), {:.2} M steps, {:.2} s", study.seen.len(), study.width(), study.columns.tolerated, study.steps as f64 / 1e6, t.elapsed().as_secs_f64());
        let mut study = study;
        let null: Vec<f64> = { let m = study.marginal(|_| 1.0).unwrap(); let idx: Vec<usize> = (0..study.seen.len()).collect(); study.ghosts.iter().map(|g| { let gs = study.sums(g, &idx, |_| 1.0); m.loss(&gs) / gs.count }).collect() };
        let s = study.nominal(|_| 1.0);
        let m = study.marginal(|_| 1.0).unwrap();
        let nm = null.iter().sum::<f64>() / null.len() as f64; let cnt = s.count;
        println!("raw {:.3} marginal {:.3} null {:.3}", s.e / s.count / nm, m.loss(&s) / s.count / nm, nm);
        let ghosts = study.ghosts.clone();
        let windows = study.seen.len();
        let mut search = qv_gap::search::Search::new(&mut study, 1.0).unwrap();
        let base = search.base(&[]).unwrap();
        let mut fits = search.suspects(&base, &[]).unwrap();
        search.temper = (base.loss / (cnt * 0.75) / nm).max(1.0);
        let locals = search.local_suspects(&base, &[]).unwrap();
        fits.truncate(5); fits.extend(locals);
        println!("base loss {:.1}", base.loss);
        let _ = (&ghosts, windows);
        for f in fits.iter() {
            let g = &study.columns.groups[f.suspect.group];
            println!("   {:9.1} rho {:9.3} {:24} {:.60} {:.4?} +- {:.4?} {:.3?}", f.evidence, f.loss / (cnt * 0.7576) / nm, study.columns.effects[g.effect].name, format!("{:?}", g.names), f.suspect.values, f.deviations, f.suspect.extent);
        }
        println!("total {:.2} M steps {:.2} s", study.steps as f64 / 1e6, t.elapsed().as_secs_f64());
    }
}
