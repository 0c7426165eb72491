// The scene: series over time as the server sends them, and their values at a time.

const EARTH_RATE = 7.2921151467e-5; // rad/s, WGS 84
const GRAVITATIONAL_PARAMETER = 3.986004418e14; // m3/s2, WGS 84

// Index of the last time at or before a time; -1 before the first.
export function indexAt(times, time) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

export class Series {
  constructor(content) {
    const { name, kind, time, craft, satellite, source, deputy, ...columns } = content;
    Object.assign(this, { name, kind, craft, satellite, source, deputy });
    this.time = time;
    this.columns = columns;
  }

  append(content) {
    this.time.push(...content.time);
    for (const [name, column] of Object.entries(this.columns)) column.push(...content[name]);
  }

  indexAt(time) {
    return indexAt(this.time, time);
  }

  // Values of the sample that holds at a time, or null: a sample holds until the next one, but no
  // longer than `longest` s.
  sampleAt(time, longest = Infinity) {
    const index = this.indexAt(time);
    if (index < 0 || time - this.time[index] > longest) return null;
    const values = {};
    for (const [name, column] of Object.entries(this.columns)) values[name] = column[index];
    return values;
  }

  // Position between samples: cubic where velocities are there, else a straight line; at most
  // one interval beyond the ends.
  positionAt(time) {
    const count = this.time.length;
    if (count === 0) return null;
    const index = Math.min(Math.max(this.indexAt(time), 0), Math.max(count - 2, 0));
    const { x, y, z, vx, vy, vz } = this.columns;
    if (count === 1) return [x[0], y[0], z[0]];
    const step = this.time[index + 1] - this.time[index];
    const part = Math.min(Math.max((time - this.time[index]) / step, -1), 2);
    return [[x, vx], [y, vy], [z, vz]].map(([place, speed]) => {
      const [first, last] = [place[index], place[index + 1]];
      if (!speed) return first + part * (last - first);
      const [leave, arrive] = [speed[index] * step, speed[index + 1] * step];
      const [squared, cubed] = [part * part, part * part * part];
      return (2 * cubed - 3 * squared + 1) * first + (cubed - 2 * squared + part) * leave
        + (3 * squared - 2 * cubed) * last + (cubed - squared) * arrive;
    });
  }
}

export class Scene {
  constructor(content) {
    this.series = new Map();
    this.cesium = content.cesium; // whether the server has it
    this.exported = "coast" in content; // the page is a file with its own pictures of the Earth
    this.coast = content.coast ?? null;
    this.beside = content.beside ? new Scene(content.beside) : null; // a second run
    this.merge(content);
  }

  // Take a scene, or what is new of it.
  merge(content) {
    this.name = content.name;
    this.startUnix = content.start_unix;
    this.duration = content.duration;
    this.live = content.live;
    this.regions = content.regions;
    this.notes = content.notes;
    this.events = content.events ?? [];
    this.hardRadius = content.hard_radius ?? 0;
    this.dipEquator = content.dip_equator ?? [];
    for (const part of content.series) {
      const known = this.series.get(part.name);
      if (known) known.append(part);
      else this.series.set(part.name, new Series(part));
    }
  }

  ofKind(kind) {
    return [...this.series.values()].filter((series) => series.kind === kind);
  }

  get(...labels) {
    return this.series.get(labels.join("/"));
  }

  // Spacecraft with an orbit, the chief first: truth where it is known, else the receiver's.
  spacecraft() {
    const names = [...new Set(this.ofKind("orbit").map((series) => series.craft))];
    const deputies = new Set(this.ofKind("relative").map((series) => series.deputy));
    const rank = (name) => (deputies.has(name) ? 2 : name === "chief" ? 0 : 1);
    return names.sort((a, b) => rank(a) - rank(b) || a.localeCompare(b));
  }

  orbit(craft) {
    return this.get("orbit", craft, "truth") ?? this.get("orbit", craft, "receiver");
  }

  // Longest time that an observation holds: epochs may be decimated.
  observationHold() {
    const link = this.ofKind("link").find((series) => series.time.length > 1);
    return link ? 1.6 * Math.max(1, (link.time.at(-1) - link.time[0]) / (link.time.length - 1)) : 2;
  }

  // Links that a receiver tracks at a time, with the positions of both ends in ITRF, m.
  linksAt(time) {
    const hold = Math.min(this.observationHold(), 10);
    const found = [];
    for (const link of this.ofKind("link")) {
      const sample = link.sampleAt(time, hold);
      const satellite = this.get("satellite", link.satellite);
      const orbit = this.orbit(link.craft);
      if (!sample || !satellite || !orbit) continue;
      found.push({
        name: link.name, craft: link.craft, satellite: link.satellite, cn0: sample.cn0_dbhz,
        from: orbit.positionAt(time), to: satellite.positionAt(time),
      });
    }
    return found;
  }

  // Deputies with relative states, with the series that is nearest to the truth.
  deputies() {
    const names = [...new Set(this.ofKind("relative").map((series) => series.deputy))];
    return names.map((deputy) => ({
      deputy, series: this.get("relative", deputy, "truth") ?? this.get("relative", deputy, "estimate"),
    })).filter(({ series }) => series);
  }

  // Rotation from the body to RTN of a spacecraft, and the direction of the magnetic field in RTN
  // (null without); the true one where it is recorded, straight between samples. Null without any.
  attitudeAt(craft, time) {
    const series = this.get("attitude", craft, "truth") ?? this.get("attitude", craft, "estimate");
    const index = series ? series.indexAt(time) : -1;
    if (index < 0) return null;
    const next = Math.min(index + 1, series.time.length - 1);
    const part = next > index ? Math.min((time - series.time[index]) / (series.time[next] - series.time[index]), 1) : 0;
    const between = (name) => {
      const values = series.columns[name];
      return values[index] === null || values[next] === null ? null : (1 - part) * values[index] + part * values[next];
    };
    const field = ["field_radial", "field_in_track", "field_cross_track"].map(between);
    return {
      quaternion: unit(["qx", "qy", "qz", "qw"].map(between)),
      field: field.includes(null) ? null : unit(field),
    };
  }

  // Value of a link by which it is coloured: cn0_dbhz, s4 or vtec_tecu; null where there is none.
  linkValue(link, time, quantity) {
    if (quantity === "cn0_dbhz") return link.cn0;
    const kind = quantity === "s4" ? "scintillation" : "pierce";
    const hold = quantity === "s4" ? 90 : 10; // s: S4 comes once a minute
    return this.get(kind, link.craft, link.satellite)?.sampleAt(time, hold)?.[quantity] ?? null;
  }

  // Radial, in-track and normal unit vectors of an orbit in ITRF at a time.
  static rtnAxes(series, time) {
    const sample = series.sampleAt(time) ?? series.sampleAt(series.time[0]);
    const place = series.positionAt(time);
    if (!place || sample?.vx === undefined) return null;
    const velocity = [sample.vx - EARTH_RATE * place[1], sample.vy + EARTH_RATE * place[0], sample.vz];
    const radial = unit(place);
    const normal = unit(cross(place, velocity));
    return [radial, cross(normal, radial), normal];
  }

  // Geodetic place below the Sun at a time, deg (Astronomical Almanac, low precision: 0.01 deg).
  subsolar(time) {
    const degrees = 180 / Math.PI;
    const days = (this.startUnix + time) / 86400 + 2440587.5 - 2451545.0;
    const anomaly = (357.528 + 0.9856003 * days) / degrees;
    const longitude = (280.460 + 0.9856474 * days + 1.915 * Math.sin(anomaly)
      + 0.020 * Math.sin(2 * anomaly)) / degrees;
    const obliquity = (23.439 - 0.0000004 * days) / degrees;
    const ascension = Math.atan2(Math.cos(obliquity) * Math.sin(longitude), Math.cos(longitude)) * degrees;
    const sidereal = 280.46062 + 360.985647366 * days;
    return {
      longitude: (((ascension - sidereal + 180) % 360) + 360) % 360 - 180,
      latitude: Math.asin(Math.sin(obliquity) * Math.sin(longitude)) * degrees,
    };
  }

  // Local time does not turn with the Earth: western side of a region at a time, deg.
  static westOf(region, time) {
    return wrapped(region.longitude_west_deg + region.longitude_rate_deg * time);
  }

  // Longitudes of the walls of plasma that a survey knows at a time, with their drift, deg.
  wallsAt(time) {
    return this.ofKind("wall").flatMap((series) => {
      const index = series.indexAt(time);
      const { longitude_deg: place, rate_deg: rate } = series.columns;
      if (index < 0 || place[index] === null) return [];
      return [wrapped(place[index] + rate[index] * (time - series.time[index]))];
    });
  }

  // One revolution of the osculating orbit, seen in the axes of the Earth at this time: (n) [x, y, z].
  static osculatingOrbit(series, time, count = 181) {
    const sample = series.sampleAt(time) ?? series.sampleAt(series.time[0]);
    const place = series.positionAt(time);
    if (!place || !series.columns.vx) return [];
    const velocity = [sample.vx - EARTH_RATE * place[1], sample.vy + EARTH_RATE * place[0], sample.vz];
    const radius = Math.hypot(...place);
    const momentum = cross(place, velocity);
    const momentumSize = Math.hypot(...momentum);
    const eccentricityVector = cross(velocity, momentum)
      .map((value, axis) => value / GRAVITATIONAL_PARAMETER - place[axis] / radius);
    const eccentricity = Math.hypot(...eccentricityVector);
    if (!(eccentricity < 0.95)) return [];
    const parameter = momentumSize ** 2 / GRAVITATIONAL_PARAMETER;
    const along = place.map((value) => value / radius);
    const across = cross(momentum, along).map((value) => value / momentumSize);
    const points = [];
    for (let step = 0; step < count; step += 1) {
      const angle = (2 * Math.PI * step) / (count - 1);
      const direction = along.map((v, axis) => v * Math.cos(angle) + across[axis] * Math.sin(angle));
      const distance = parameter / (1 + dot(direction, eccentricityVector));
      points.push(direction.map((value) => value * distance));
    }
    return points;
  }
}

// Geodetic longitude and latitude, deg, and height, m, of a position in ITRF (WGS 84, Bowring).
export function geodetic([x, y, z]) {
  const major = 6378137.0;
  const flattening = 1 / 298.257223563;
  const minor = major * (1 - flattening);
  const squared = flattening * (2 - flattening);
  const across = Math.hypot(x, y);
  const angle = Math.atan2(z * major, across * minor);
  const latitude = Math.atan2(
    z + (squared * major * major / minor) * Math.sin(angle) ** 3,
    across - squared * major * Math.cos(angle) ** 3,
  );
  const normal = major / Math.sqrt(1 - squared * Math.sin(latitude) ** 2);
  const height = across * Math.cos(latitude) + z * Math.sin(latitude) - (major * major) / normal;
  const degrees = 180 / Math.PI;
  return { longitude: Math.atan2(y, x) * degrees, latitude: latitude * degrees, height };
}

function wrapped(longitude) {
  return ((((longitude + 180) % 360) + 360) % 360) - 180;
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function unit(a) {
  const size = Math.hypot(...a);
  return a.map((value) => value / size);
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
