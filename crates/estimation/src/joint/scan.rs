//! The scan factor: the mean distance of a scanner's points from a surfel within a step.

use super::bend::{BENDING, Bends, CAUSES};
use super::motion::{AT_BRIDGE, GaussMarkov, Motion, NodeGradient, StepPoses};
use super::row::RowBatch;
use super::surfel::{DriveRows, RowPoint, ScanRow, Surfel};
use crate::calibration::ScannerSample;
use crate::geometry::{BodyFromScanner, Mat3, Vec3, bent};

/// What a scan factor depends on besides the motion.
pub struct Seen<'a> {
    pub rows: &'a DriveRows,
    pub samples: &'a [&'a ScannerSample],
    pub surfels: &'a [Surfel],
    /// (a, b, c) of each surfel.
    pub shapes: &'a [Vec3],
    pub mountings: Vec<BodyFromScanner>,
    /// How mountings move, and which drive this is.
    pub bends: Option<&'a Bends>,
    pub drive: usize,
    /// How late the profiles of each scanner are.
    pub late_s: &'a [f64],
}

/// A weighted mean of points: r = (d₀/d) (h̄ − (a + b ū + c v̄)), metres, with h, u, v the coordinates of
/// x_m = t_mb + R_mb (t_bs + R_bs x_s) in the frame of the surfel, d = n·R_mb R_bs x̄_s how far the
/// points lie below the scanner along the surfel's normal, and d₀ what it was when they were sorted.
///
/// A mounting that is turned shows all relief lower by a factor, noise and roughness with it: without
/// d₀/d, the least squares would lie where the relief is lowest. Its standard deviation follows d.
#[derive(Debug, Clone, Copy)]
pub struct Mean {
    /// r.
    pub residual_m: f64,
    /// By (a, b, c).
    pub by_shape: [f64; 3],
    /// By the leading unknowns of both nodes of the step and by its bridge. Each profile has its own
    /// share of them: the shares at the mean time would be off by a twentieth for positions and by
    /// half for velocities.
    pub by_nodes: NodeGradient,
    /// By the mounting (δφ, δp).
    pub by_mounting: [f64; 6],
    /// By compliance and creep, and by the knot behind: each profile has its own load and share of the knots.
    pub by_compliance: [f64; BENDING],
    pub by_next_knot: [f64; 6],
    /// By how late the profile is.
    pub by_late: f64,
    /// d, metres.
    pub depth_m: f64,
    /// Mean time of the profiles, seconds.
    pub time_s: f64,
}

/// Where points lie as close to the plane through the scanner, there is no relief to scale, metres.
const LEAST_DEPTH_M: f64 = 0.05;

impl Mean {
    /// Multiplies by d₀/d, with the derivatives of d by the mounting and by how late it is.
    fn scale(&mut self, depth_m: f64, by_mounting: &[f64; 6], by_late: f64) {
        let factor = depth_m / self.depth_m;
        self.residual_m *= factor;
        let share = self.residual_m / self.depth_m;
        self.by_shape = self.by_shape.map(|x| x * factor);
        self.by_nodes = self.by_nodes.map(|x| x * factor);
        for (by, of_depth) in self.by_mounting.iter_mut().zip(by_mounting) {
            *by = *by * factor - share * of_depth;
        }
        // What d turns with them is left out: a residual over d, a thousandth.
        self.by_compliance = self.by_compliance.map(|x| x * factor);
        self.by_next_knot = self.by_next_knot.map(|x| x * factor);
        self.by_late = self.by_late * factor - share * by_late;
    }
}

/// Where a profile was taken from.
struct Profile {
    time_s: f64,
    /// Of the body in the world.
    rotation: Mat3,
    translation_m: Vec3,
    velocity_m_s: Vec3,
    rate_rad_s: Vec3,
    /// Of the scanner in the body.
    scanner_rotation: Mat3,
    scanner_translation_m: Vec3,
    /// What moves its mounting, and the share of the knot behind; zero where there is none.
    causes: [f64; CAUSES],
    next_share: f64,
}

fn six(a: Vec3, b: Vec3) -> [f64; 6] {
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

/// The profiles of a step.
pub struct StepScans<'a> {
    seen: &'a Seen<'a>,
    poses: &'a StepPoses,
    /// Of each scanner those from the first to the last one that has points here, and the number of the first.
    profiles: Vec<(u32, Vec<Profile>)>,
    /// Of each scanner's mounting; empty where there are no knots. A latency may carry a row across a knot: it
    /// stays with those of its step.
    between: Vec<BetweenKnots>,
}

/// Where a step lies among the knots of a mounting.
struct BetweenKnots {
    /// The one before.
    knot: usize,
    from_s: f64,
    to_s: f64,
}

impl BetweenKnots {
    fn new(process: &GaussMarkov, poses: &StepPoses) -> Self {
        let ends = [poses.knots.first(), poses.knots.last()]
            .into_iter()
            .flatten();
        let middle_s = ends.map(|pose| 0.5 * pose.time_s).sum();
        let (knot, _) = process.locate(middle_s);
        Self {
            knot,
            from_s: process.knot_s[knot],
            to_s: process.knot_s[knot + 1],
        }
    }

    /// The share of the knot behind.
    fn share(&self, time_s: f64) -> f64 {
        ((time_s - self.from_s) / (self.to_s - self.from_s)).clamp(0.0, 1.0)
    }
}

impl<'a> StepScans<'a> {
    /// Those that these rows need.
    pub fn new(seen: &'a Seen<'a>, poses: &'a StepPoses, rows: &[ScanRow]) -> Self {
        let knots = seen.bends.and_then(|bends| bends.knots.get(seen.drive));
        let between = knots.into_iter().flatten();
        let mut scans = Self {
            seen,
            poses,
            between: between
                .map(|process| BetweenKnots::new(process, poses))
                .collect(),
            profiles: Vec::new(),
        };
        let mut ranges = vec![(u32::MAX, 0); seen.mountings.len()];
        for row in rows {
            let (first, last) = &mut ranges[row.scanner as usize];
            for point in seen.rows.points_of(row) {
                *first = point.profile.min(*first);
                *last = point.profile.max(*last);
            }
        }
        let profiles = ranges.iter().enumerate().map(|(scanner, &(first, last))| {
            let profiles = (first..=last).map(|profile| scans.find(scanner, profile));
            (first, profiles.collect())
        });
        scans.profiles = profiles.collect();
        scans
    }

    fn find(&self, scanner: usize, profile: u32) -> Profile {
        let stamp_s = self.seen.samples[scanner].profiles[profile as usize].time_s;
        let time_s = stamp_s - self.seen.late_s[scanner];
        let pose = self.poses.at(time_s);
        let mean = &self.seen.mountings[scanner];
        let bends = self.seen.bends;
        let now = bends.map(|bends| bent(mean, &bends.offset(self.seen.drive, scanner, time_s)));
        let mounting = now.as_ref().unwrap_or(mean);
        let between = self.between.get(scanner);
        Profile {
            time_s,
            rotation: *pose.world_from_body.rotation.to_rotation_matrix().matrix(),
            translation_m: pose.world_from_body.translation_m,
            velocity_m_s: pose.velocity_m_s,
            rate_rad_s: pose.rate_rad_s,
            scanner_rotation: *mounting.rotation.to_rotation_matrix().matrix(),
            scanner_translation_m: mounting.translation_m,
            causes: bends.map_or([0.0; _], |bends| bends.causes(self.seen.drive, time_s)),
            next_share: between.map_or(0.0, |between| between.share(time_s)),
        }
    }

    fn profile(&self, scanner: usize, profile: u32) -> &Profile {
        let (first, profiles) = &self.profiles[scanner];
        &profiles[(profile - first) as usize]
    }

    /// The first point of a row in the world.
    pub fn first_point_m(&self, row: &ScanRow) -> Vec3 {
        let point = &self.seen.rows.points_of(row)[0];
        let from = self.profile(row.scanner as usize, point.profile);
        let in_body = from.scanner_rotation * point.position_m + from.scanner_translation_m;
        from.translation_m + from.rotation * in_body
    }

    /// The mean of a row; `depth_m` is d₀.
    pub fn mean(&self, row: &ScanRow, points: &[RowPoint], depth_m: f64) -> Mean {
        let scanner = row.scanner as usize;
        let surfel = &self.seen.surfels[row.surfel as usize];
        let shape = &self.seen.shapes[row.surfel as usize];
        let [normal, u_axis, v_axis] = &surfel.axes;
        // ∂r by the point.
        let direction = normal - u_axis * shape.y - v_axis * shape.z;
        let (mean, arm, mut found) = self.along(scanner, &direction, &surfel.centre_m, points);
        let (u, v) = (u_axis.dot(&mean), v_axis.dot(&mean));
        found.residual_m = normal.dot(&mean) - (shape.x + shape.y * u + shape.z * v);
        found.by_shape = [-1.0, -u, -v];
        // The depth turns with the profile in the middle: it is the factor of a small residual.
        let pose = self.profile(scanner, points[points.len() / 2].profile);
        let in_body = pose.rotation.tr_mul(normal);
        found.depth_m = in_body.dot(&arm);
        if depth_m.abs() > LEAST_DEPTH_M && found.depth_m * depth_m > 0.0 {
            let moment = six(arm.cross(&in_body), Vec3::zeros());
            let by_late = -in_body.dot(&pose.rate_rad_s.cross(&arm));
            found.scale(depth_m, &moment, by_late);
            let by_pose = moment.map(|x| -x * found.residual_m / found.depth_m);
            self.poses
                .pull_back(pose.time_s, &by_pose, &mut found.by_nodes);
        }
        found
    }

    /// The mean of points of a scanner from `origin_m`, world; the mean of their arms R_bs x_s, body; and the
    /// derivatives of the mean along a direction of the world.
    pub fn along(
        &self,
        scanner: usize,
        direction: &Vec3,
        origin_m: &Vec3,
        points: &[RowPoint],
    ) -> (Vec3, Vec3, Mean) {
        let mut sum = Vec3::zeros();
        let mut by_nodes: NodeGradient = [0.0; _];
        let (mut by_mounting, mut by_next_knot) = ([0.0; 6], [0.0; 6]);
        let mut by_compliance = [0.0; BENDING];
        let mut by_late = 0.0;
        let count: f64 = points.iter().map(|point| point.weight).sum();
        let mut all_arms = Vec3::zeros();
        let mut times_s = 0.0;
        for group in points.chunk_by(|a, b| a.profile == b.profile) {
            let pose = self.profile(scanner, group[0].profile);
            let in_body = pose.rotation.tr_mul(direction);
            let mut arms = Vec3::zeros();
            for point in group {
                arms += pose.scanner_rotation * point.position_m * point.weight;
            }
            // All are linear in the points of one profile.
            let n: f64 = group.iter().map(|point| point.weight).sum();
            times_s += pose.time_s * n;
            let levers = arms + pose.scanner_translation_m * n;
            let offset = pose.translation_m - origin_m;
            sum += pose.rotation * levers + offset * n;
            let by_pose = six(levers.cross(&in_body) / count, direction * (n / count));
            self.poses.pull_back(pose.time_s, &by_pose, &mut by_nodes);
            let by = six(arms.cross(&in_body) / count, in_body * (n / count));
            for (sum, by) in by_mounting.iter_mut().zip(by) {
                *sum += by;
            }
            if let Some(bends) = self.seen.bends {
                for (i, sum) in by_compliance[..bends.unknowns()].iter_mut().enumerate() {
                    *sum += by[i % 6] * pose.causes[i / 6];
                }
                for (sum, by) in by_next_knot.iter_mut().zip(by) {
                    *sum += by * pose.next_share;
                }
            }
            all_arms += arms;
            let turning = pose.rate_rad_s.cross(&levers);
            by_late -= direction.dot(&pose.velocity_m_s) * n + in_body.dot(&turning);
        }
        let found = Mean {
            residual_m: 0.0,
            by_shape: [0.0; 3],
            by_nodes,
            by_mounting,
            by_compliance,
            by_next_knot,
            by_late: by_late / count,
            depth_m: 0.0,
            time_s: times_s / count,
        };
        (sum / count, all_arms / count, found)
    }
}

/// The blocks of a drive's scan factors.
pub struct ScanBlocks {
    /// Of the drive's motion.
    pub first_motion: usize,
    pub first_surfel: usize,
    /// Of each scanner's mounting.
    pub mountings: Vec<usize>,
    /// Of each scanner's latency, where it is estimated.
    pub late: Vec<Option<usize>>,
    /// Of each scanner's compliance and of its first knot in this drive; empty where there are none.
    pub compliance: Vec<usize>,
    pub knots: Vec<usize>,
    /// Unknowns of a compliance and what is behind it.
    pub bending: usize,
}

/// Adds the rows of a step; `sigma_m` and the group of a row come from `noise`.
pub fn rows(
    seen: &Seen<'_>,
    motion: &dyn Motion,
    step: usize,
    blocks: &ScanBlocks,
    noise: &(dyn Fn(&ScanRow) -> (usize, f64) + Sync),
    batch: &mut RowBatch,
) {
    let rows = seen.rows.of_step(step);
    if rows.is_empty() {
        return;
    }
    let poses = motion.poses(step);
    let scans = StepScans::new(seen, &poses, rows);
    for row in rows {
        let mean = scans.mean(row, seen.rows.points_of(row), row.depth_m);
        let (group, sigma_m) = noise(row);
        let w = 1.0 / sigma_m;
        batch.begin_robust(row.trust, group, mean.residual_m * w);
        batch.touch(
            blocks.first_surfel + row.surfel as usize,
            &mean.by_shape.map(|x| x * w),
        );
        let what = (row.scanner as usize, &mean, w);
        place((&scans, motion), step, blocks, what, batch);
    }
}

/// Adds derivatives of a mean, times `w`, by all that places points: the motion and the mounting.
pub fn place(
    (scans, motion): (&StepScans<'_>, &dyn Motion),
    step: usize,
    blocks: &ScanBlocks,
    (scanner, mean, w): (usize, &Mean, f64),
    batch: &mut RowBatch,
) {
    let (nodes, width) = (motion.pose_blocks(step), scans.poses.width);
    let by = mean.by_nodes.map(|x| x * w);
    batch.touch(blocks.first_motion + nodes[0], &by[..width]);
    batch.touch(blocks.first_motion + nodes[1], &by[width..2 * width]);
    if let Some(bridge) = motion.bridge_block(step) {
        batch.touch(blocks.first_motion + bridge, &by[AT_BRIDGE..]);
    }
    if let Some(late) = blocks.late[scanner] {
        batch.touch(late, &[mean.by_late * w]);
    }
    let by_mounting = mean.by_mounting.map(|x| x * w);
    if let Some(&compliance) = blocks.compliance.get(scanner) {
        let by = mean.by_compliance.map(|x| x * w);
        batch.touch(compliance, &by[..blocks.bending]);
    }
    if let (Some(first), Some(between)) = (blocks.knots.get(scanner), scans.between.get(scanner)) {
        let next = mean.by_next_knot.map(|x| x * w);
        let before: [f64; 6] = std::array::from_fn(|i| by_mounting[i] - next[i]);
        batch.touch(first + between.knot, &before);
        batch.touch(first + between.knot + 1, &next);
    }
    batch.touch(blocks.mountings[scanner], &by_mounting);
}
