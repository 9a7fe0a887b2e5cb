// Lines and marks: the trajectory, its axes, the platform with its scanners, and the picked point.

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, Group, Line, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial,
} from 'three';
import { apply, compose, exaggerated } from '../data/transform.js';

/** Length of the axes, metres. */
const AXIS_M = 0.35;
/** Most poses drawn along the trajectory. */
const WAY_POINTS = 4000;

function geometry(points) {
  const made = new BufferGeometry();
  made.setAttribute('position', new BufferAttribute(new Float32Array(points.flat()), 3));
  return made;
}

/** Exempts an object from culling by its bounds. */
function unculled(object) {
  object.frustumCulled = false;
  return object;
}

/** The trajectory, as positions from the origin. */
export function way(drive, variant) {
  const fan = drive.fans.reduce((a, b) => (b.counts.length > a.counts.length ? b : a));
  const every = Math.max(1, Math.ceil(fan.counts.length / WAY_POINTS));
  const positions = [];
  for (let profile = 0; profile < fan.counts.length; profile += every) {
    positions.push(drive.pose(variant, fan, profile).t);
  }
  return positions;
}

export function wayLine(positions, colour) {
  return unculled(new Line(geometry(positions), new LineBasicMaterial({ color: colour })));
}

/** The axes of the body at a pose: x, y and z. */
export function axes(pose, colours, length = AXIS_M) {
  const group = new Group();
  [[length, 0, 0], [0, length, 0], [0, 0, length]].forEach((tip, i) => {
    const ends = [pose.t, apply(pose, tip)];
    group.add(unculled(new LineSegments(geometry(ends), new LineBasicMaterial({ color: colours[i] }))));
  });
  return group;
}


/** A cross at a point, of a size in metres. */
export function cross(at, size, colour) {
  const ends = [0, 1, 2].flatMap((axis) => [-1, 1].map((sign) => at.map((x, i) => x + (i === axis ? sign * size : 0))));
  const object = unculled(new LineSegments(geometry(ends), new LineBasicMaterial({ color: colour, depthTest: false })));
  object.renderOrder = 2;
  return object;
}

/** The corners of a quadrilateral as a closed line. */
export function outline(corners, colour) {
  const object = unculled(new Line(geometry([...corners, corners[0]]), new LineBasicMaterial({ color: colour, depthTest: false })));
  object.renderOrder = 1;
  return object;
}

/**
 * The platform at a time: its axes, and for each scanner the fan of the profile nearest to that time, with `factor`
 * times the offset of its mounting.
 */
export function platform(drive, variant, timeS, factor, colours) {
  const group = new Group();
  drive.fans.forEach((fan) => {
    if (fan.counts.length === 0) return;
    const profile = nearestProfile(drive, fan, timeS);
    const body = drive.pose(variant, fan, profile);
    const mean = drive.variants[variant].mountings[fan.number];
    const mounting = exaggerated(drive.mounting(variant, fan, profile), mean, factor);
    const scanner = compose(body, mounting);
    const points = profilePoints(drive, fan, profile).map((x) => apply(scanner, x));
    const colour = colours.series[fan.number % colours.series.length];
    if (fan.number === 0) group.add(axes(body, colours.axes, 0.5));
    group.add(unculled(new Line(geometry([body.t, scanner.t]), new LineBasicMaterial({ color: colours.ink }))));
    // The axes at the mean mounting.
    group.add(axes(compose(body, mean), [colours.muted, colours.muted, colours.muted], 0.15));
    group.add(axes(scanner, colours.axes, 0.22));
    if (points.length > 1) {
      const triangles = points.slice(1).flatMap((point, i) => [scanner.t, points[i], point]);
      const material = new MeshBasicMaterial({ color: new Color(colour), transparent: true, opacity: 0.3, side: DoubleSide, depthWrite: false });
      group.add(unculled(new Mesh(geometry(triangles), material)));
      group.add(unculled(new Line(geometry(points), new LineBasicMaterial({ color: colour }))));
    }
  });
  return group;
}

export function nearestProfile(drive, fan, timeS) {
  const wanted = (timeS - drive.startS) / drive.stepS;
  let [low, high] = [0, fan.times.length - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (fan.times[middle] < wanted) low = middle + 1;
    else high = middle;
  }
  const isBefore = low > 0 && wanted - fan.times[low - 1] < fan.times[low] - wanted;
  return isBefore ? low - 1 : low;
}

/** The points of a profile in the scanner frame, in order around the scanner. */
function profilePoints(drive, fan, profile) {
  const first = fan.profileOf.indexOf(profile);
  const points = Array.from({ length: fan.counts[profile] }, (_, i) => drive.inScanner(fan, first + i));
  return points.sort((a, b) => Math.atan2(a[0], -a[2]) - Math.atan2(b[0], -b[2]));
}

/** Frees the memory of a group on the graphics card, and removes the group. */
export function dispose(object) {
  object?.traverse((part) => {
    part.geometry?.dispose();
    part.material?.dispose();
  });
  object?.removeFromParent();
}
