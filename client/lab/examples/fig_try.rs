use foretrace_lab::experiments::*;
use foretrace_lab::data::*;
use foretrace_lab::path::Placement;
fn main() {
    let mut draft = foretrace_config::Draft::preset("ur5");
    for a in std::env::args().skip(3) { let (k,v)=a.split_once('=').unwrap(); draft = draft.set(k,v); }
    let config = draft.finish().unwrap();
    let dir = std::env::args().nth(1).unwrap();
    let label = std::env::args().nth(2).unwrap();
    let set = DataSet::load(std::path::Path::new(&dir), Split::Test, false).unwrap();
    let labels = if label == "all" { Labels::All } else { Labels::One(label) };
    let (letters, skipped) = letters(&set, &labels, &Placement::default()).unwrap();
    println!("{} letters, {skipped} skipped", letters.len());
    let t = std::time::Instant::now();
    let f = fig2(&config, &letters, || {}).unwrap();
    for r in &f.rows { if std::env::var("SHORT").is_ok() && r.arm==Fig2Arm::Ur5 {continue;} println!("{:?} {:?} mse {:.3e} median {:.3e} max {:.4} medmax {:.4} lag {:.1}", r.arm, r.predictor, r.mse_m2, r.median_mse_m2, r.max_m, r.median_max_m, r.lag_ms); }
    let g = fig3(&config, &letters, || {}).unwrap();
    println!("fig3 {} letters jerk {:.3} irr {:.3} unnoticed {:.3} in {:?}", g.letters.len(), g.max_jerk_ratio, g.irregularity, g.unnoticed, t.elapsed());
}
