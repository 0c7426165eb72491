// The globe: CesiumJS with the imagery that comes with it; nothing is asked of other machines.

import { CN0_RANGE, REGION, cividis, craftColour, partOf } from "./colours.js";
import { Scene, geodetic } from "./scene.js";

const BASE = "cesium/";
const TEC_RANGE_ROOM = 1; // TECU: a flat ionosphere is no full scale of colours
const ORBIT_REFRESH = 20; // s of scene time between osculating ellipses
const MOST_RIBBON_POINTS = 1500;

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
    view.globe.enableLighting = false;
    view.globe.showGroundAtmosphere = false;
    view.skyAtmosphere.show = false;
    if (view.moon) view.moon.show = false;
    view.screenSpaceCameraController.maximumZoomDistance = 2e8;
    this.lines = view.primitives.add(new Cesium.PolylineCollection());
    this.points = view.primitives.add(new Cesium.PointPrimitiveCollection());
    this.names = view.primitives.add(new Cesium.LabelCollection());
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
        // Close to each other on this scale, so one name above and one below.
        pixelOffset: new Cesium.Cartesian2(12, index ? 20 : -12),
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
    this.widget.clock.currentTime = this.Cesium.JulianDate.fromDate(
      new Date((this.scene.startUnix + time) * 1000),
    );
    if (this.following) this.followChief();
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
      const [red, green, blue] = cividis(partOf(link.cn0, CN0_RANGE));
      line.material.uniforms.color = Cesium.Color.fromBytes(red, green, blue, 230);
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

  // The message does not tell the height: above the orbit, where a ray leaves towards the satellite.
  pierceHeight(craft, time) {
    const orbit = this.scene.orbit(craft);
    const height = orbit ? geodetic(orbit.positionAt(time)).height : 0;
    return Math.max(height + 20e3, 350e3);
  }

  cartesian([x, y, z]) {
    return new this.Cesium.Cartesian3(x, y, z);
  }

  // Turn the camera: to the whole Earth with the links, after the chief, or to a region.
  look(where) {
    const { Cesium } = this;
    const { camera } = this.widget.scene;
    this.following = where === "chief";
    camera.lookAtTransform(Cesium.Matrix4.IDENTITY);
    const [first] = this.scene.spacecraft();
    if (where === "region" && this.scene.regions.length) {
      const [region] = this.scene.regions;
      const west = Scene.westOf(region, this.time);
      const destination = Cesium.Cartesian3.fromDegrees(
        west + region.width_deg / 2, region.latitude_south_deg - 32, 3.2e6,
      );
      camera.setView({ destination, orientation: { heading: 0, pitch: -0.75, roll: 0 } });
    } else if (where === "chief") {
      this.range = null;
      this.followChief();
    } else {
      const place = first ? geodetic(this.scene.orbit(first).positionAt(this.time)) : null;
      camera.setView({
        destination: Cesium.Cartesian3.fromDegrees(
          place?.longitude ?? 0, (place?.latitude ?? 0) * 0.6 + 4, 8.5e7,
        ),
      });
    }
    this.widget.scene.requestRender();
  }

  // Keep the chief in the middle and let the user turn about it.
  followChief() {
    const { Cesium } = this;
    const { camera } = this.widget.scene;
    const [first] = this.scene.spacecraft();
    if (!first) return;
    const place = this.cartesian(this.scene.orbit(first).positionAt(this.time));
    const offset = this.range === null
      ? new Cesium.HeadingPitchRange(0.4, -0.6, 2.5e6)
      : Cesium.Cartesian3.clone(camera.position);
    camera.lookAtTransform(Cesium.Transforms.eastNorthUpToFixedFrame(place), offset);
    this.range = 1;
  }
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
