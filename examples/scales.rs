use boresight::format;
use boresight::geometry::*;
use boresight::pipeline::stages::{self, Poses};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::Scenario;
use boresight::trajectory::Trajectory;
use std::path::Path;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let folder = Path::new(&a[1]);
    let mut project = Project::read(&folder.join("project.toml")).unwrap();
    if a.len() > 3 {
        project.calibration.voxel_sizes_m = a[3..].iter().map(|x| x.parse().unwrap()).collect();
    }
    let reference = if a[2].contains('n') {
        vec![]
    } else {
        stages::reference(&project, &Silent).unwrap()
    };
    let poses = if a[2].contains('e') {
        Poses::exact(
            Trajectory::new(format::read_trajectory(&folder.join("truth/trajectory.csv")).unwrap())
                .unwrap(),
        )
    } else {
        stages::poses(&project, &Silent).unwrap()
    };
    let truth = Scenario::demo().true_mountings();
    if a[2].contains('t') {
        for (s, t) in project.scanners.iter_mut().zip(&truth) {
            s.body_from_scanner = *t;
        }
    }
    let samples = stages::samples(&project, &poses.trajectory, &Silent).unwrap();
    let c = stages::calibration(
        &project,
        &project.calibration,
        &poses,
        &samples,
        &reference,
        &Silent,
    )
    .unwrap();
    for s in &c.scales {
        print!(
            "{:.3} pts {} ref {} it {} {} {:.1}s |",
            s.voxel_m, s.points, s.reference_points, s.iterations, s.ending, s.seconds
        );
        for (i, m) in s.mountings.iter().enumerate() {
            let d = (m.body_from_scanner.translation.vector - truth[i].translation.vector) * 1e3;
            let w = so3::log(&(m.body_from_scanner.rotation * truth[i].rotation.inverse()))
                .map(f64::to_degrees);
            print!(
                " t {:.2} {:.2} {:.2} w {:.4} {:.4} {:.4} |",
                d.x, d.y, d.z, w.x, w.y, w.z
            );
        }
        println!();
    }
}
