//! The scan factor: the mean distance of a scanner's points from a surfel within a step.

use super::bend::{BENDING, Bends, CAUSES};
use super::layout::ScannerBlocks;
use super::motion::{AT_BRIDGE, GaussMarkov, Motion, NodeGradient, StepPoses};
use super::row::RowBatch;
use super::surfel::{DriveRows, RowPoint, ScanRow, Surfel};
use crate::calibration::ScannerSample;
use crate::geometry::{BodyFromScanner, Mat3, Vec3, bent, product, transposed_product};

/// Inputs of the scan factors of a drive, besides the motion.
pub struct ScanContext<'a> {
    pub rows: &'a DriveRows,
    pub samples: &'a [&'a ScannerSample],
    pub surfels: &'a [Surfel],
    /// (a, b, c) of each surfel.
    pub shapes: &'a [Vec3],
    pub mountings: Vec<BodyFromScanner>,
    /// Motion of the mountings; `None` if they are rigid.
    pub bends: Option<&'a Bends>,
    /// Index of the drive.
    pub drive: usize,
    /// Latency of each scanner's profiles, seconds.
    pub late_s: &'a [f64],
}

/// A weighted mean of points: r = (d₀/d) (h̄ − (a + b ū + c v̄)), metres, with h, u, v the coordinates of
/// x_m = t_mb + R_mb (t_bs + R_bs x_s) in the frame of the surfel, d = n·R_mb R_bs x̄_s how far the
/// points lie below the scanner along the surfel's normal, and d₀ its value when they were sorted.
///
/// Turning a mounting lowers all relief, noise and roughness by a factor. Without d₀/d, least squares
/// would therefore favour the lowest relief. The standard deviation of the distance is proportional to d.
#[derive(Debug, Clone, Copy)]
pub struct Mean {
    /// r.
    pub residual_m: f64,
    /// Derivatives by (a, b, c).
    pub by_shape: [f64; 3],
    /// Derivatives by the leading unknowns of both nodes of the step and by its bridge. Each profile has
    /// its own share of them: the shares at the mean time would be off by a twentieth for positions and
    /// by half for velocities.
    pub by_nodes: NodeGradient,
    /// Derivatives by the mounting (δφ, δp).
    pub by_mounting: [f64; 6],
    /// Derivatives by compliance, creep and log columns; each profile has its own load.
    pub by_compliance: [f64; BENDING],
    /// Derivatives by the later knot; each profile has its own share of the knots.
    pub by_next_knot: [f64; 6],
    /// Derivative by the latency of the profiles.
    pub by_late: f64,
    /// Derivative by what is added to all ranges.
    pub by_range: f64,
    /// d, metres.
    pub depth_m: f64,
    /// Mean time of the profiles, seconds.
    pub time_s: f64,
}

/// Least |d| at which residuals are scaled, metres: a surface whose plane passes closer to the scanner shows no
/// relief to scale.
const LEAST_DEPTH_M: f64 = 0.05;

/// Whether the residual of a row is multiplied by d₀/d, given both.
fn is_scaled(depth_m: f64, now_m: f64) -> bool {
    depth_m.abs() > LEAST_DEPTH_M && now_m * depth_m > 0.0
}

impl Mean {
    /// Multiplies by d₀/d, given the derivatives of d by the mounting and by the latency, and the profile at which they
    /// are taken.
    fn scale(&mut self, depth_m: f64, by_mounting: &[f64; 6], by_late: f64, profile: &Profile) {
        let factor = depth_m / self.depth_m;
        self.residual_m *= factor;
        let share = self.residual_m / self.depth_m;
        self.by_shape = self.by_shape.map(|x| x * factor);
        self.by_nodes = self.by_nodes.map(|x| x * factor);
        for (by, depth_by) in self.by_mounting.iter_mut().zip(by_mounting) {
            *by = *by * factor - share * depth_by;
        }
        for (i, by) in self.by_compliance.iter_mut().enumerate() {
            *by = *by * factor - share * by_mounting[i % 6] * profile.causes[i / 6];
        }
        for (by, depth_by) in self.by_next_knot.iter_mut().zip(by_mounting) {
            *by = *by * factor - share * depth_by * profile.next_share;
        }
        self.by_late = self.by_late * factor - share * by_late;
    }
}

/// The pose of the scanner during a profile.
struct Profile {
    time_s: f64,
    /// Rotation of the body in the world.
    rotation: Mat3,
    translation_m: Vec3,
    velocity_m_s: Vec3,
    rate_rad_s: Vec3,
    /// Rotation of the scanner in the body.
    scanner_rotation: Mat3,
    scanner_translation_m: Vec3,
    /// Values of the causes that move its mounting; zero if it is rigid.
    causes: [f64; CAUSES],
    /// Share of the later knot of its mounting; zero without knots.
    next_share: f64,
}

impl Profile {
    /// The number of laser points that these points of the profile represent, and the sum of their arms R_bs x_s, body.
    fn arms(&self, points: &[RowPoint]) -> (f64, Vec3) {
        let (mut count, mut sum) = (0.0, Vec3::zeros());
        for point in points {
            count += point.weight;
            sum += point.position_m * point.weight;
        }
        (count, product(&self.scanner_rotation, &sum))
    }

    /// The sum of `n` points relative to `origin_m`, world, given the sum of their arms.
    fn placed(&self, n: f64, arms: &Vec3, origin_m: &Vec3) -> Vec3 {
        let levers = arms + self.scanner_translation_m * n;
        product(&self.rotation, &levers) + (self.translation_m - origin_m) * n
    }
}

fn six(a: Vec3, b: Vec3) -> [f64; 6] {
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

/// The profiles of a step.
pub struct StepScans<'a> {
    context: &'a ScanContext<'a>,
    poses: &'a StepPoses,
    /// For each scanner, the index of its first profile with points here, and its profiles from this to the last
    /// one.
    profiles: Vec<(u32, Vec<Profile>)>,
    /// The knots of each scanner's mounting around the step; empty without knots. If a latency carries a row across a
    /// knot, the row stays with the knots of its step.
    between: Vec<BetweenKnots>,
}

/// The interval between knots of a mounting that contains a step.
struct BetweenKnots {
    /// Index of the knot before.
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

    /// The share of the later knot.
    fn share(&self, time_s: f64) -> f64 {
        ((time_s - self.from_s) / (self.to_s - self.from_s)).clamp(0.0, 1.0)
    }
}

impl<'a> StepScans<'a> {
    /// The profiles that these rows need.
    pub fn new(context: &'a ScanContext<'a>, poses: &'a StepPoses, rows: &[ScanRow]) -> Self {
        let knots = context
            .bends
            .and_then(|bends| bends.knots.get(context.drive));
        let between = knots.into_iter().flatten();
        let mut scans = Self {
            context,
            poses,
            between: between
                .map(|process| BetweenKnots::new(process, poses))
                .collect(),
            profiles: Vec::new(),
        };
        let mut ranges = vec![(u32::MAX, 0); context.mountings.len()];
        for row in rows {
            let (first, last) = &mut ranges[row.scanner as usize];
            for point in context.rows.points_of(row) {
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
        let stamp_s = self.context.samples[scanner].profiles[profile as usize].time_s;
        let time_s = stamp_s - self.context.late_s[scanner];
        let pose = self.poses.at(time_s);
        let mean = &self.context.mountings[scanner];
        let bends = self.context.bends;
        let now = bends.map(|bends| bent(mean, &bends.offset(self.context.drive, scanner, time_s)));
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
            causes: bends.map_or([0.0; _], |bends| bends.causes(self.context.drive, time_s)),
            next_share: between.map_or(0.0, |between| between.share(time_s)),
        }
    }

    fn profile(&self, scanner: usize, profile: u32) -> &Profile {
        let (first, profiles) = &self.profiles[scanner];
        &profiles[(profile - first) as usize]
    }

    /// The first point of a row in the world.
    pub fn first_point_m(&self, row: &ScanRow) -> Vec3 {
        let point = &self.context.rows.points_of(row)[0];
        let from = self.profile(row.scanner as usize, point.profile);
        let in_body =
            product(&from.scanner_rotation, &point.position_m) + from.scanner_translation_m;
        from.translation_m + product(&from.rotation, &in_body)
    }

    /// The residual of a row as in [`Self::mean`], without derivatives, metres.
    pub fn residual_m(&self, row: &ScanRow) -> f64 {
        let points = self.context.rows.points_of(row);
        let scanner = row.scanner as usize;
        let surfel = &self.context.surfels[row.surfel as usize];
        let (mut sum, mut arms) = (Vec3::zeros(), Vec3::zeros());
        let count: f64 = points.iter().map(|point| point.weight).sum();
        for group in points.chunk_by(|a, b| a.profile == b.profile) {
            let pose = self.profile(scanner, group[0].profile);
            let (n, arm) = pose.arms(group);
            arms += arm;
            sum += pose.placed(n, &arm, &surfel.centre_m);
        }
        let (mean, arm) = (sum / count, arms / count);
        let residual_m = self.height_m(row, &mean);
        let pose = self.profile(scanner, points[points.len() / 2].profile);
        let now_m = transposed_product(&pose.rotation, &surfel.axes[0]).dot(&arm);
        if is_scaled(row.depth_m, now_m) {
            residual_m * (row.depth_m / now_m)
        } else {
            residual_m
        }
    }

    /// The height of a point above the plane of a row's surfel, given relative to the surfel's centre, metres:
    /// h − (a + b u + c v).
    fn height_m(&self, row: &ScanRow, point_m: &Vec3) -> f64 {
        let [normal, u_axis, v_axis] = &self.context.surfels[row.surfel as usize].axes;
        let shape = &self.context.shapes[row.surfel as usize];
        let (u, v) = (u_axis.dot(point_m), v_axis.dot(point_m));
        normal.dot(point_m) - (shape.x + shape.y * u + shape.z * v)
    }

    /// The mean of a row.
    pub fn mean(&self, row: &ScanRow) -> Mean {
        let points = self.context.rows.points_of(row);
        let scanner = row.scanner as usize;
        let surfel = &self.context.surfels[row.surfel as usize];
        let shape = &self.context.shapes[row.surfel as usize];
        let [normal, u_axis, v_axis] = &surfel.axes;
        // Gradient of r by the point.
        let direction = normal - u_axis * shape.y - v_axis * shape.z;
        let (mean, arm, mut row_mean) = self.along(scanner, &direction, &surfel.centre_m, points);
        let (u, v) = (u_axis.dot(&mean), v_axis.dot(&mean));
        row_mean.residual_m = self.height_m(row, &mean);
        row_mean.by_shape = [-1.0, -u, -v];
        // The pose of the middle profile is enough for the derivative of the depth, the factor of a small residual.
        let pose = self.profile(scanner, points[points.len() / 2].profile);
        let in_body = transposed_product(&pose.rotation, normal);
        row_mean.depth_m = in_body.dot(&arm);
        // The points of a row lie in nearly the same direction.
        row_mean.by_range = row_mean.depth_m / arm.norm();
        if is_scaled(row.depth_m, row_mean.depth_m) {
            let moment = six(arm.cross(&in_body), Vec3::zeros());
            let by_late = -in_body.dot(&pose.rate_rad_s.cross(&arm));
            row_mean.scale(row.depth_m, &moment, by_late, pose);
            let by_pose = moment.map(|x| -x * row_mean.residual_m / row_mean.depth_m);
            self.poses
                .pull_back(pose.time_s, &by_pose, &mut row_mean.by_nodes);
        }
        row_mean
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
            let in_body = transposed_product(&pose.rotation, direction);
            // All sums are linear in the points of one profile.
            let (n, arms) = pose.arms(group);
            times_s += pose.time_s * n;
            let levers = arms + pose.scanner_translation_m * n;
            sum += pose.placed(n, &arms, origin_m);
            let by_pose = six(levers.cross(&in_body) / count, direction * (n / count));
            self.poses.pull_back(pose.time_s, &by_pose, &mut by_nodes);
            let by = six(arms.cross(&in_body) / count, in_body * (n / count));
            for (sum, by) in by_mounting.iter_mut().zip(by) {
                *sum += by;
            }
            if let Some(bends) = self.context.bends {
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
        let along = Mean {
            residual_m: 0.0,
            by_shape: [0.0; 3],
            by_nodes,
            by_mounting,
            by_compliance,
            by_next_knot,
            by_late: by_late / count,
            by_range: 0.0,
            depth_m: 0.0,
            time_s: times_s / count,
        };
        (sum / count, all_arms / count, along)
    }

    /// Adds the derivatives of a mean of a scanner, times `w`, by all unknowns that place points: the motion and the
    /// mounting.
    pub fn place(
        &self,
        scanner: usize,
        mean: &Mean,
        w: f64,
        blocks: &StepBlocks<'_>,
        batch: &mut RowBatch,
    ) {
        let (width, drive) = (self.poses.width, blocks.drive);
        let by = mean.by_nodes.map(|x| x * w);
        batch.touch(blocks.nodes[0], &by[..width]);
        batch.touch(blocks.nodes[1], &by[width..2 * width]);
        if let Some(bridge) = blocks.bridge {
            batch.touch(bridge, &by[AT_BRIDGE..]);
        }
        if let Some(late) = drive.of_scanners.late[scanner] {
            batch.touch(late, &[mean.by_late * w]);
        }
        if let Some(range) = drive.of_scanners.range[scanner] {
            batch.touch(range, &[mean.by_range * w]);
        }
        let by_mounting = mean.by_mounting.map(|x| x * w);
        let motions = drive.of_scanners.motions.iter();
        for motion in motions.filter(|motion| motion.is_of(self.context.drive, scanner)) {
            motion.touch(mean.time_s, &by_mounting, batch);
        }
        if let Some(&compliance) = drive.compliance.get(scanner) {
            let by = mean.by_compliance.map(|x| x * w);
            batch.touch(compliance, &by[..drive.bending]);
        }
        if let (Some(first), Some(between)) = (drive.knots.get(scanner), self.between.get(scanner))
        {
            let next = mean.by_next_knot.map(|x| x * w);
            let before: [f64; 6] = std::array::from_fn(|i| by_mounting[i] - next[i]);
            batch.touch(first + between.knot, &before);
            batch.touch(first + between.knot + 1, &next);
        }
        batch.touch(drive.mountings[scanner], &by_mounting);
    }
}

/// The blocks of a drive's scan factors.
pub struct ScanBlocks {
    /// First block of the drive's motion.
    pub first_motion: usize,
    pub first_surfel: usize,
    /// The block of each scanner's mounting.
    pub mountings: Vec<usize>,
    /// The blocks of the scanners' constants.
    pub of_scanners: ScannerBlocks,
    /// The block of each scanner's compliance; empty without compliance.
    pub compliance: Vec<usize>,
    /// The block of each scanner's first knot in this drive; empty without knots.
    pub knots: Vec<usize>,
    /// Number of unknowns of a compliance with its creep and log columns.
    pub bending: usize,
}

impl ScanBlocks {
    /// The blocks with those of a step of the motion.
    pub fn of_step(&self, motion: &dyn Motion, step: usize) -> StepBlocks<'_> {
        let place = |block: usize| self.first_motion + block;
        StepBlocks {
            drive: self,
            nodes: motion.pose_blocks(step).map(place),
            bridge: motion.bridge_block(step).map(place),
        }
    }
}

/// The blocks of the scan factors in a step.
pub struct StepBlocks<'a> {
    drive: &'a ScanBlocks,
    /// The blocks of the two nodes of the step.
    nodes: [usize; 2],
    /// The block of its bridge, if it has one.
    bridge: Option<usize>,
}

/// Adds the rows of a step; `sigma_m` and the group of a row come from `noise`.
pub fn rows(
    context: &ScanContext<'_>,
    motion: &dyn Motion,
    step: usize,
    blocks: &ScanBlocks,
    noise: &(dyn Fn(&ScanRow) -> (usize, f64) + Sync),
    batch: &mut RowBatch,
) {
    let rows = context.rows.of_step(step);
    if rows.is_empty() {
        return;
    }
    let poses = motion.poses(step);
    let scans = StepScans::new(context, &poses, rows);
    let of_step = blocks.of_step(motion, step);
    for row in rows {
        let (group, sigma_m) = noise(row);
        let w = 1.0 / sigma_m;
        if !batch.has_derivatives() {
            let residual_m = scans.residual_m(row);
            batch.begin_robust(row.trust, group, residual_m * w);
            continue;
        }
        let mean = scans.mean(row);
        batch.begin_robust(row.trust, group, mean.residual_m * w);
        batch.touch(
            blocks.first_surfel + row.surfel as usize,
            &mean.by_shape.map(|x| x * w),
        );
        scans.place(row.scanner as usize, &mean, w, &of_step, batch);
    }
}
