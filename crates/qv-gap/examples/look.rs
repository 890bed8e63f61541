use qv_gap::columns::Columns;
use qv_gap::problem::{Cut, Problem};
use qv_gap::study::{EXTRA, Effort, Study};
use qv_gap::{evidence, library};
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
        let problem = Problem::new(&run, &model, &terrain, &[], Cut::default()).unwrap();
        let columns = Columns::new(&problem, &run, &library::built_in()).unwrap();
        let study = Study::new(problem, columns, &run, &Effort::default()).unwrap();
        println!("{path}: {} windows, {} columns ({} tolerated), {:.2} M steps, {:.2} s", study.seen.len(), study.width(), study.columns.tolerated, study.steps as f64 / 1e6, t.elapsed().as_secs_f64());
        let m = study.marginal(|_| 1.0).unwrap();
        let s = study.nominal(|_| 1.0);
        println!("loss/count: raw {:.3} marginal {:.3}", s.e / s.count, m.loss(&s) / s.count);
        for (k, g) in study.ghosts.iter().enumerate() {
            let idx: Vec<usize> = (0..study.seen.len()).collect();
            let gs = study.sums(g, &idx, |_| 1.0);
            print!(" g{k} {:.3}/{:.3}", gs.e / gs.count, m.loss(&gs) / gs.count);
        }
        println!();
        let rank = |s: &evidence::Sums, temper: f64| {
            let force = m.force(s);
            let mut found = Vec::new();
            for (g, group) in study.columns.groups.iter().enumerate() {
                let effect = &study.columns.effects[group.effect];
                for level in 0..effect.levels.len() {
                    let axes = effect.axes.len();
                    let mut d = nalgebra::DMatrix::zeros(study.width(), axes);
                    let mut wide = vec![];
                    for a in 0..axes {
                        for u in study.columns.units_of(group, a) {
                            if let Some(c) = study.columns.column(u, level) {
                                d[(EXTRA + c, a)] = 1.0;
                                let col = &study.columns.columns[c];
                                let absent = study.columns.units[u].absent;
                                if wide.len() == a { wide.push(if absent.is_finite() { (0.4 * effect.span() / (col.value - absent)).abs() } else { 1.0 }); }
                            }
                        }
                    }
                    if wide.len() < axes { continue; }
                    if let Some((bf, best)) = evidence::widen(&m.curvature, &force, &d, &wide, temper) { found.push((bf, g, level, best)); }
                }
            }
            found.sort_by(|a, b| b.0.total_cmp(&a.0));
            found
        };
        // By channel: rms of the whitened-by-own-variance? print law and motion parts of the fitted residual.
        let dev = m.deviations(&s);
        let part = |moving: bool| {
            let (mut motion, mut law, mut n, mut nl) = (0.0, 0.0, 0, 0);
            let m1 = study.seen[0].raw.motion.len();
            let mut byj = vec![0.0; 12];
            for w in study.seen.iter().filter(|w| w.window.moving == moving) {
                let left = &w.residual - w.j.columns(0, study.tolerance.len()) * &dev;
                motion += left.rows(0, m1).norm_squared(); n += m1;
                let l = left.rows(m1, left.len() - m1);
                law += l.norm_squared(); nl += l.len();
                for j in 0..12 { byj[j] += l.rows(j * 30, 30).norm_squared() / 30.0; }
            }
            println!("   moving {moving}: motion {:.3} law {:.3} by joint {:.2?}", motion / n.max(1) as f64, law / nl.max(1) as f64, byj.iter().map(|x| x * 360.0 / nl.max(1) as f64).collect::<Vec<_>>());
            // raw motion rms by channel group
            let mut chan: std::collections::BTreeMap<&str, (f64, f64, usize)> = Default::default();
            for w in study.seen.iter().filter(|w| w.window.moving == moving) {
                let mut i = 0;
                for c in &study.problem.channels { let wd = qv_gap::observe::width(*c, 6); for k in i..i+wd { let e = chan.entry(c.name()).or_default(); e.0 += w.raw.motion[k].powi(2); e.2 += 1; } i += wd; }
            }
            for (name, e) in chan { print!("     {name} {:.5}", (e.0 / e.2 as f64).sqrt()); }
            println!();
        };
        part(false); part(true);
        println!("   noise {:?}", study.noise);
        println!("   shift {:?}", dev[0]);
        let l0 = m.loss(&s) / s.count;
        let r = rank(&s, 1.0);
        let mut names = vec![];
        for (bf, g, level, best) in &r {
            let group = &study.columns.groups[*g];
            let e = &study.columns.effects[group.effect];
            if names.iter().filter(|n| **n == &e.name).count() >= 2 || names.len() > 24 { continue; }
            names.push(&e.name);
            println!("   {:9.1} {:24} {:?} level {} amount {:?}", bf, e.name, group.names, e.levels[*level], best.as_slice());
        }
        let _ = l0;
        for (k, g) in study.ghosts.iter().enumerate().take(4) {
            let idx: Vec<usize> = (0..study.seen.len()).collect();
            let gs = study.sums(g, &idx, |_| 1.0);
            let r = rank(&gs, 1.0);
            print!(" ghost {k}: ");
            for (bf, gg, _, _) in r.iter().take(5) { print!("{} {:?} {:.1}; ", study.columns.effects[study.columns.groups[*gg].effect].name, study.columns.groups[*gg].names, bf); }
            println!();
        }
    }
}
