//! The on-line identification of a load on a simulated robot under computed torque.

#[path = "../robot/mod.rs"]
mod robot;
mod rig;

use rig::{GRASP_M, Rig, settings};
use shared::arm::Load;
use shared::load::LoadNews;

#[test]
fn probe() {
    for mass in [0.0, 0.3, 1.72, 2.5] {
        let mut rig = Rig::new(settings(0.002), Load { mass_kg: mass, centre_m: GRASP_M, inertia_kg_m2: 0.0 });
        rig.run(5000);
        for (row, news) in &rig.news {
            println!("{mass} row {row} {news:?}");
        }
        println!("largest error {:?} steps {}", rig.largest_error(0..5000), rig.replica_steps);
    }
    for seed in 0..10 {
        let mut rig = Rig::new(settings(0.03), Load { mass_kg: 1.0, centre_m: GRASP_M, inertia_kg_m2: 0.0 });
        rig.spoil_model(seed, 0.03, 0.05);
        rig.run(10000);
        for (row, news) in &rig.news {
            match news { 
                LoadNews::Found(e) => println!("seed {seed} row {row} found {} ± {} noise {}", e.mass_kg, e.standard_error_kg, e.noise_ratio),
                LoadNews::Changed{..} | LoadNews::Rejected(..) => println!("seed {seed} row {row} {news:?}"),
                _ => {}
            }
        }
    }
}
