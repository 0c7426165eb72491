// The globe: CesiumJS with the imagery that comes with it; nothing is asked of other machines.

import { CN0_RANGE, REGION, S4_RANGE, WALL, WALL_LATITUDE, cividis, craftColour, partOf } from "./colours.js";
import { FormationView } from "./formation.js";
import { Scene, geodetic } from "./scene.js";

const BASE = "cesium/";
const TEC_RANGE_ROOM = 1; // TECU: a flat ionosphere is no full scale of colours
const ORBIT_REFRESH = 20; // s of scene time between osculating ellipses
const MOST_RIBBON_POINTS = 1500;
// Distance of the camera from the centre of the Earth, m: the Earth fills the pane; all GNSS orbits.
const EARTH_RANGE = 1.5e7;
const LINKS_RANGE = 9e7;
const WALL_HEIGHT = 400e3; // m
const WALL_POINTS = Array.from({ length: 11 }, (_, index) => (index / 5 - 1) * WALL_LATITUDE);
const BORESIGHT = "#ff8fab"; // as the z axis close up
const FAR_LIGHT = 1e10; // m: day and night are drawn at any distance

// Load Cesium; rejects where it is not installed or the browser has no WebGL.
export async function makeGlobe(container, scene) {
  window.CESIUM_BASE_URL = BASE;
  if (!scene.cesium) throw new Error("Cesium is not installed (tools/install_viewer.sh)");
  const style = document.createElement("link");
  style.rel = "stylesheet";
  style.href = `${BASE}Widgets/CesiumWidget/CesiumWidget.css`;
  document.head.append(style);
  const Cesium = await import(`./${BASE}index.js`);
  return new Globe(Cesium, container, scene);
}

class Globe {
  constructor(Cesium, container, scene) {
    this.Cesium = Cesium;
    this.scene = scene;
    this.time = 0;
    this.links = new Map();
    this.pierces = new Map();
    this.satellites = new Map();
    this.crafts = new Map();
    this.regions = [];
    this.edges = new Map();
    this.walls = [];
    this.boresights = new Map();
    this.quantity = "cn0_dbhz"; // by which links are coloured
    this.orbitTime = null;
    this.widget = new Cesium.CesiumWidget(container, {
      baseLayer: Cesium.ImageryLayer.fromProviderAsync(
        Cesium.TileMapServiceImageryProvider.fromUrl(
          Cesium.buildModuleUrl("Assets/Textures/NaturalEarthII"),
        ),
      ),
      creditContainer: document.createElement("div"),
      requestRenderMode: true,
      maximumRenderTimeChange: Infinity,
      showRenderLoopErrors: false,
      scene3DOnly: true,
      useBrowserRecommendedResolution: true,
    });
    const { scene: view } = this.widget;
    view.globe.enableLighting = true; // the terminator
    view.globe.lightingFadeOutDistance = FAR_LIGHT;
    view.globe.lightingFadeInDistance = 2 * FAR_LIGHT;
    view.globe.nightFadeOutDistance = FAR_LIGHT;
    view.globe.nightFadeInDistance = 2 * FAR_LIGHT;
    view.globe.showGroundAtmosphere = false;
    view.skyAtmosphere.show = false;
    if (view.moon) view.moon.show = false;
    view.screenSpaceCameraController.maximumZoomDistance = 2e8;
    view.screenSpaceCameraController.minimumZoomDistance = 0.5;
    view.camera.frustum.near = 0.1;
    this.lines = view.primitives.add(new Cesium.PolylineCollection());
    this.points = view.primitives.add(new Cesium.PointPrimitiveCollection());
    this.names = view.primitives.add(new Cesium.LabelCollection());
    this.formation = new FormationView(Cesium, scene, view);
    this.update();
    this.look("earth");
  }

  get counts() {
    const shown = [...this.links.values()].filter((line) => line.show).length;
    return { spacecraft: this.crafts.size, links: shown };
  }

  // Take in what is new in the scene.
  update() {
    this.scene.spacecraft().forEach((craft, index) => {
      if (!this.crafts.has(craft)) this.crafts.set(craft, this.addCraft(craft, index));
      this.crafts.get(craft).track.positions = this.groundTrack(craft);
    });
    this.addRegions();
    this.addDipEquator();
    this.formation.update();
    this.orbitTime = null;
    if (this.ribbon) this.widget.scene.primitives.remove(this.ribbon);
    this.ribbon = this.makeRibbon();
    if (this.ribbon) this.widget.scene.primitives.add(this.ribbon);
  }

  addCraft(craft, index) {
    const { Cesium } = this;
    const colour = Cesium.Color.fromCssColorString(craftColour(index));
    const orbitMaterial = index === 0
      ? Cesium.Material.fromType("Color", { color: colour.withAlpha(0.95) })
      : Cesium.Material.fromType("PolylineDash", { color: colour, dashLength: 18 });
    return {
      colour,
      orbit: this.lines.add({ width: index ? 2.5 : 1.8, material: orbitMaterial }),
      track: this.lines.add({
        width: 3, material: Cesium.Material.fromType("Color", { color: colour.withAlpha(0.75) }),
      }),
      point: this.points.add({
        pixelSize: index ? 9 : 12, color: colour, outlineColor: Cesium.Color.WHITE,
        outlineWidth: 1.5, disableDepthTestDistance: 1e6,
      }),
      name: this.names.add({
        text: craft, font: "600 14px sans-serif", fillColor: colour,
        outlineColor: Cesium.Color.BLACK, outlineWidth: 3,
        style: Cesium.LabelStyle.FILL_AND_OUTLINE,
        // Close to each other on this scale, so one name above and the others below each other.
        pixelOffset: new Cesium.Cartesian2(12, index ? 4 + 16 * index : -12),
      }),
    };
  }

  groundTrack(craft) {
    const { x, y, z } = this.scene.orbit(craft).columns;
    const places = [];
    const step = Math.max(1, Math.floor(x.length / 800));
    for (let index = 0; index < x.length; index += step) {
      const { longitude, latitude } = geodetic([x[index], y[index], z[index]]);
      places.push(this.Cesium.Cartesian3.fromDegrees(longitude, latitude, 8000));
    }
    return places.length > 1 ? places : [];
  }

  addDipEquator() {
    const { Cesium } = this;
    if (this.dipEquator || !this.scene.dipEquator.length) return;
    const material = Cesium.Material.fromType("PolylineDash", {
      color: Cesium.Color.WHITE.withAlpha(0.8), dashLength: 12,
    });
    const positions = this.scene.dipEquator.map(([lon, lat]) => Cesium.Cartesian3.fromDegrees(lon, lat, 15e3));
    this.dipEquator = this.lines.add({ width: 1.5, material, positions });
  }

  addRegions() {
    const { Cesium } = this;
    this.scene.regions.slice(this.regions.length).forEach((region) => {
      const colour = Cesium.Color.fromCssColorString(REGION);
      const bounds = new Cesium.CallbackProperty(() => {
        const west = Scene.westOf(region, this.time);
        const east = ((west + region.width_deg + 180) % 360) - 180;
        return Cesium.Rectangle.fromDegrees(
          west, region.latitude_south_deg, east, region.latitude_north_deg,
        );
      }, false);
      this.regions.push(region);
      this.widget.entities.add({
        name: region.name,
        rectangle: {
          coordinates: bounds, height: region.altitude_bottom, extrudedHeight: region.altitude_top,
          material: colour.withAlpha(0.35), outline: true, outlineColor: colour,
        },
      });
    });
  }

  // Vertical TEC above the chief, as a coloured wall that stands on its ground track.
  makeRibbon() {
    const { Cesium, scene } = this;
    const craft = scene.spacecraft().find((name) => scene.ofKind("pierce").some((s) => s.craft === name));
    if (!craft) return null;
    const samples = verticalTec(scene, craft);
    if (samples.length < 2) return null;
    const values = samples.map((sample) => sample.tec);
    let [low, high] = [Math.min(...values), Math.max(...values)];
    if (high - low < TEC_RANGE_ROOM) [low, high] = [low - TEC_RANGE_ROOM / 2, high + TEC_RANGE_ROOM / 2];
    this.tecRange = [low, high];
    const orbit = scene.orbit(craft);
    const places = [];
    const colours = [];
    for (const { time, tec } of samples) {
      const { longitude, latitude } = geodetic(orbit.positionAt(time));
      places.push(Cesium.Cartesian3.fromDegrees(longitude, latitude, 40e3));
      const [red, green, blue] = cividis(partOf(tec, this.tecRange));
      colours.push(Cesium.Color.fromBytes(red, green, blue, 255));
    }
    return new Cesium.Primitive({
      asynchronous: false,
      geometryInstances: new Cesium.GeometryInstance({
        geometry: new Cesium.PolylineGeometry({
          positions: places, colors: colours, colorsPerVertex: true, width: 8,
          arcType: Cesium.ArcType.NONE,
          vertexFormat: Cesium.PolylineColorAppearance.VERTEX_FORMAT,
        }),
      }),
      appearance: new Cesium.PolylineColorAppearance({ translucent: false }),
    });
  }

  draw(time) {
    this.time = time;
    this.drawCrafts(time);
    this.drawLinks(time);
    this.drawPierces(time);
    this.drawEdges(time);
    this.drawWalls(time);
    this.drawBoresights(time);
    this.widget.clock.currentTime = this.Cesium.JulianDate.fromDate(
      new Date((this.scene.startUnix + time) * 1000),
    );
    this.follow();
    this.formation.draw(time, this.Cesium.Cartesian3.magnitude(this.widget.scene.camera.position));
    this.widget.scene.requestRender();
  }

  drawCrafts(time) {
    const renew = this.orbitTime === null || Math.abs(time - this.orbitTime) > ORBIT_REFRESH;
    if (renew) this.orbitTime = time;
    for (const [craft, parts] of this.crafts) {
      const orbit = this.scene.orbit(craft);
      const place = this.cartesian(orbit.positionAt(time));
      parts.point.position = place;
      parts.name.position = place;
      if (renew) {
        parts.orbit.positions = Scene.osculatingOrbit(orbit, time).map((p) => this.cartesian(p));
      }
    }
  }

  drawLinks(time) {
    const { Cesium } = this;
    const links = this.scene.linksAt(time);
    const present = new Set(links.map((link) => link.name));
    for (const [name, line] of this.links) line.show = present.has(name);
    const seen = new Map(links.map((link) => [link.satellite, link.to]));
    for (const link of links) {
      let line = this.links.get(link.name);
      if (!line) {
        const material = Cesium.Material.fromType("Color");
        line = this.lines.add({ width: 1.6, material });
        this.links.set(link.name, line);
      }
      line.positions = [this.cartesian(link.from), this.cartesian(link.to)];
      const value = this.scene.linkValue(link, time, this.quantity);
      const [red, green, blue] = value === null ? [150, 150, 150] : cividis(partOf(value, this.colourRange));
      const alpha = this.camera === "formation" ? 90 : value === null ? 120 : 230;
      line.material.uniforms.color = Cesium.Color.fromBytes(red, green, blue, alpha);
    }
    for (const satellite of seen.keys()) {
      if (!this.satellites.has(satellite)) this.satellites.set(satellite, this.addSatellite(satellite));
    }
    for (const [satellite, parts] of this.satellites) {
      const place = seen.get(satellite);
      parts.point.show = Boolean(place);
      parts.name.show = Boolean(place);
      if (place) {
        parts.point.position = this.cartesian(place);
        parts.name.position = this.cartesian(place);
      }
    }
  }

  addSatellite(satellite) {
    const { Cesium } = this;
    return {
      point: this.points.add({ pixelSize: 6, color: Cesium.Color.WHITE }),
      name: this.names.add({
        text: satellite, font: "12px sans-serif", fillColor: Cesium.Color.WHITE,
        outlineColor: Cesium.Color.BLACK, outlineWidth: 3,
        style: Cesium.LabelStyle.FILL_AND_OUTLINE, pixelOffset: new Cesium.Cartesian2(7, -6),
      }),
    };
  }

  drawPierces(time) {
    const { Cesium, scene } = this;
    for (const series of scene.ofKind("pierce")) {
      const sample = series.sampleAt(time, 10);
      let point = this.pierces.get(series.name);
      if (!sample || sample.latitude_deg === null) {
        if (point) point.show = false;
        continue;
      }
      if (!point) {
        point = this.points.add({
          pixelSize: 8, outlineColor: Cesium.Color.BLACK, outlineWidth: 1,
        });
        this.pierces.set(series.name, point);
      }
      const [red, green, blue] = cividis(partOf(sample.vtec_tecu ?? 0, this.tecRange ?? [0, 1]));
      point.show = true;
      point.color = Cesium.Color.fromBytes(red, green, blue, 255);
      point.position = Cesium.Cartesian3.fromDegrees(
        sample.longitude_deg, sample.latitude_deg, this.pierceHeight(series.craft, time),
      );
    }
  }

  // Edges of irregularities that were found up to a time; the regions are the true ones.
  drawEdges(time) {
    const { Cesium } = this;
    for (const series of this.scene.ofKind("boundary")) {
      series.time.forEach((at, index) => {
        const key = `${series.name}/${index}`;
        let parts = this.edges.get(key);
        if (!parts) {
          const column = (name) => series.columns[name][index];
          const position = Cesium.Cartesian3.fromDegrees(column("longitude_deg"), column("latitude_deg"), column("altitude"));
          parts = [
            this.points.add({
              pixelSize: 9, color: Cesium.Color.TRANSPARENT, outlineColor: Cesium.Color.fromCssColorString(REGION),
              outlineWidth: 3, position,
            }),
            this.names.add({
              text: `${column("entry") ? "in" : "out"} ${(column("altitude") / 1e3).toFixed(1)} km`,
              font: "11px sans-serif", fillColor: Cesium.Color.WHITE, outlineColor: Cesium.Color.BLACK,
              outlineWidth: 3, style: Cesium.LabelStyle.FILL_AND_OUTLINE, position,
              pixelOffset: new Cesium.Cartesian2(9, 4),
              distanceDisplayCondition: new Cesium.DistanceDisplayCondition(0, 6e6), // else they cover each other
            }),
          ];
          this.edges.set(key, parts);
        }
        for (const part of parts) part.show = at <= time;
      });
    }
  }

  // Walls of plasma as a survey knows them, at the height of its orbit.
  drawWalls(time) {
    const { Cesium } = this;
    const longitudes = this.scene.wallsAt(time);
    while (this.walls.length < longitudes.length) {
      const material = Cesium.Material.fromType("Color", { color: Cesium.Color.fromCssColorString(WALL) });
      this.walls.push(this.lines.add({ width: 2, material }));
    }
    this.walls.forEach((wall, index) => {
      wall.show = index < longitudes.length;
      if (!wall.show) return;
      wall.positions = WALL_POINTS.map((latitude) => Cesium.Cartesian3.fromDegrees(longitudes[index], latitude, WALL_HEIGHT));
    });
  }

  // Where the z axis of a spacecraft with an attitude meets the ground: what a camera there sees.
  drawBoresights(time) {
    const { Cesium } = this;
    for (const craft of this.scene.spacecraft()) {
      const attitude = this.scene.attitudeAt(craft, time);
      const axes = attitude && Scene.rtnAxes(this.scene.orbit(craft), time);
      if (!axes) continue;
      let parts = this.boresights.get(craft);
      if (!parts) {
        const colour = Cesium.Color.fromCssColorString(BORESIGHT);
        const material = Cesium.Material.fromType("Color", { color: colour.withAlpha(0.8) });
        parts = {
          ray: this.lines.add({ width: 2, material }),
          spot: this.points.add({
            pixelSize: 11, color: Cesium.Color.TRANSPARENT, outlineColor: colour, outlineWidth: 3,
            disableDepthTestDistance: 1e6,
          }),
        };
        this.boresights.set(craft, parts);
      }
      const [x, y, z, w] = attitude.quaternion;
      const zAxis = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]; // in RTN
      const direction = [0, 1, 2].map((k) => axes.reduce((sum, axis, i) => sum + zAxis[i] * axis[k], 0));
      const from = this.cartesian(this.scene.orbit(craft).positionAt(time));
      const ray = new Cesium.Ray(from, this.cartesian(direction));
      const hit = Cesium.IntersectionTests.rayEllipsoid(ray, Cesium.Ellipsoid.WGS84);
      parts.ray.show = Boolean(hit) && this.camera !== "formation";
      parts.spot.show = parts.ray.show;
      if (!hit) continue;
      const ground = Cesium.Ray.getPoint(ray, hit.start);
      parts.ray.positions = [from, ground];
      parts.spot.position = ground;
    }
  }

  // Quantity by which the links are coloured, and its range.
  colourBy(quantity) {
    this.quantity = quantity;
  }

  get colourRange() {
    if (this.quantity === "s4") return S4_RANGE;
    return this.quantity === "vtec_tecu" ? this.tecRange ?? [0, 50] : CN0_RANGE;
  }

  // The message does not tell the height: above the orbit, where a ray leaves towards the satellite.
  pierceHeight(craft, time) {
    const orbit = this.scene.orbit(craft);
    const height = orbit ? geodetic(orbit.positionAt(time)).height : 0;
    return Math.max(height + 20e3, 350e3);
  }

  cartesian([x, y, z]) {
    return new this.Cesium.Cartesian3(x, y, z);
  }

  // Turn the camera: the Earth below the formation, the Earth with all links, after the chief, into
  // the formation, or to a region. All but the last follow; the user may turn and zoom meanwhile.
  look(where) {
    const { Cesium } = this;
    const { camera } = this.widget.scene;
    this.camera = where;
    this.placed = false; // whether the camera has its place in the frame that it looks into
    this.formation.show(where === "formation");
    // Close up the marks of spacecraft on the globe would stand in the way.
    for (const parts of this.crafts.values()) {
      for (const part of [parts.point, parts.name, parts.orbit]) part.show = where !== "formation";
    }
    if (where === "region" && this.scene.regions.length) {
      const [region] = this.scene.regions;
      const west = Scene.westOf(region, this.time);
      const destination = Cesium.Cartesian3.fromDegrees(
        west + region.width_deg / 2, region.latitude_south_deg - 32, 3.2e6,
      );
      camera.lookAtTransform(Cesium.Matrix4.IDENTITY);
      camera.setView({ destination, orientation: { heading: 0, pitch: -0.75, roll: 0 } });
    }
    this.follow();
    this.widget.scene.requestRender();
  }

  // Keep what the camera looks at in the middle.
  follow() {
    const { Cesium } = this;
    const [first] = this.scene.spacecraft();
    const orbit = first && this.scene.orbit(first);
    if (!orbit || this.camera === "region") return;
    const place = this.cartesian(orbit.positionAt(this.time));
    if (this.camera === "chief") {
      this.lookAlong(Cesium.Transforms.eastNorthUpToFixedFrame(place), new Cesium.HeadingPitchRange(0.4, -0.6, 2.5e6));
    } else if (this.camera === "formation") {
      const frame = this.formation.frame(this.time);
      // Axes for the camera: N to the right, T into the picture, R up.
      const turned = frame && Cesium.Matrix4.multiplyByMatrix3(
        frame, new Cesium.Matrix3(0, 0, 1, 0, 1, 0, -1, 0, 0), new Cesium.Matrix4(),
      );
      if (turned) this.lookAlong(turned, new Cesium.HeadingPitchRange(-0.9, -0.35, this.formation.fittingRange(this.time)));
    } else {
      const [up, east, north] = upEastNorth(Cesium, place);
      const rotation = new Cesium.Matrix3(up.x, east.x, north.x, up.y, east.y, north.y, up.z, east.z, north.z);
      const transform = Cesium.Matrix4.fromRotationTranslation(rotation, Cesium.Cartesian3.ZERO);
      const range = this.camera === "links" ? LINKS_RANGE : EARTH_RANGE;
      this.lookAlong(transform, new Cesium.Cartesian3(range, 0, 0));
    }
  }

  // Look at the origin of a frame from where the user has turned to, first from `start`.
  lookAlong(transform, start) {
    const { camera } = this.widget.scene;
    const offset = this.placed ? this.Cesium.Cartesian3.clone(camera.position) : start;
    camera.lookAtTransform(transform, offset);
    this.placed = true;
  }

  // Draw now, so that the canvas can be read: WebGL forgets its picture after the frame.
  redraw() {
    this.widget.scene.render();
  }
}

// Unit vectors up, east and north at a position.
function upEastNorth(Cesium, place) {
  const frame = Cesium.Transforms.eastNorthUpToFixedFrame(place);
  return [2, 0, 1].map((column) => {
    const { x, y, z } = Cesium.Matrix4.getColumn(frame, column, new Cesium.Cartesian4());
    return new Cesium.Cartesian3(x, y, z);
  });
}

// Median over the satellites of the vertical TEC above a spacecraft, over time.
export function verticalTec(scene, craft) {
  const byTime = new Map();
  for (const series of scene.ofKind("pierce")) {
    if (series.craft !== craft) continue;
    const step = Math.max(1, Math.floor(series.time.length / MOST_RIBBON_POINTS));
    for (let index = 0; index < series.time.length; index += step) {
      const value = series.columns.vtec_tecu[index];
      if (value === null) continue;
      const second = Math.round(series.time[index]);
      if (!byTime.has(second)) byTime.set(second, []);
      byTime.get(second).push(value);
    }
  }
  return [...byTime.entries()].sort((a, b) => a[0] - b[0]).map(([time, values]) => {
    const sorted = values.sort((a, b) => a - b);
    return { time, tec: sorted[sorted.length >> 1] };
  });
}
