// Map of the ground tracks on a plain canvas: what is shown where Cesium is not installed, and in
// an exported page. The same canvas shows the formation close up.

import { CN0_RANGE, REGION, S4_RANGE, WALL, WALL_LATITUDE, cividis, craftColour, css, partOf } from "./colours.js";
import { placeLabels, prepare } from "./canvas.js";
import { CloseView } from "./closeup.js";
import { Scene, geodetic } from "./scene.js";

// Tiles of the Earth that come with Cesium, from the north west: 4 by 2 pictures.
const TILES = [4, 2];
const NARROWEST = 1.4; // width of the map over its height: a phone shows it with room above and below
const LABEL_ROOM = 44; // pixels for the name of a meridian
const NIGHT = "rgba(4, 8, 20, .5)";

export class GroundMap {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.linkCount = 0;
    this.quantity = "cn0_dbhz";
    this.tiles = this.loadTiles();
    this.close = new CloseView(canvas, scene);
    canvas.hidden = false;
  }

  update() {
    this.close.update();
  }

  look(camera) {
    this.close.shown = camera === "formation";
  }

  colourBy(quantity) {
    this.quantity = quantity;
  }

  get colourRange() {
    return { s4: S4_RANGE, vtec_tecu: [0, 50] }[this.quantity] ?? CN0_RANGE;
  }

  // Pictures of the Earth, where they are installed or came with an exported page.
  loadTiles() {
    const { scene } = this;
    if (!scene.cesium && !scene.coast) return [];
    const tiles = [];
    for (let column = 0; column < TILES[0]; column += 1) {
      for (let row = 0; row < TILES[1]; row += 1) {
        const image = new Image();
        const name = `1/${column}/${TILES[1] - 1 - row}.jpg`; // rows of tiles count from the south
        image.src = scene.coast?.[name] ?? `cesium/Assets/Textures/NaturalEarthII/${name}`;
        tiles.push({ image, column, row });
      }
    }
    return tiles;
  }

  get counts() {
    return { spacecraft: this.scene.spacecraft().length, links: this.linkCount };
  }

  draw(time) {
    const { context, width, height: room } = prepare(this.canvas);
    if (this.close.shown) {
      this.close.draw(context, width, room, time);
      return;
    }
    const height = Math.min(room, width / NARROWEST);
    context.fillStyle = "#0b1016";
    context.fillRect(0, 0, width, room);
    context.translate(0, (room - height) / 2);
    const toX = (longitude) => ((longitude + 180) / 360) * width;
    const toY = (latitude) => ((90 - latitude) / 180) * height;
    context.fillStyle = "#10202e";
    context.fillRect(0, 0, width, height);
    for (const { image, column, row } of this.tiles) {
      if (!image.complete || !image.naturalWidth) continue;
      const [wide, high] = [width / TILES[0], height / TILES[1]];
      context.drawImage(image, column * wide, row * high, wide + 0.5, high + 0.5);
    }
    this.drawNight(context, time, toX, toY, width, height);
    this.drawGrid(context, toX, toY, width, height);
    this.drawDipEquator(context, toX, toY);
    for (const region of this.scene.regions) {
      context.fillStyle = "rgba(204, 121, 167, .35)";
      context.strokeStyle = REGION;
      const west = Scene.westOf(region, time);
      const box = [toX(west), toY(region.latitude_north_deg), (region.width_deg / 360) * width,
        toY(region.latitude_south_deg) - toY(region.latitude_north_deg)];
      context.fillRect(...box);
      context.strokeRect(...box);
    }
    context.strokeStyle = WALL;
    context.lineWidth = 1.5;
    for (const longitude of this.scene.wallsAt(time)) {
      segment(context, toX(longitude), toY(WALL_LATITUDE), toX(longitude), toY(-WALL_LATITUDE));
    }
    const links = this.scene.linksAt(time);
    this.linkCount = links.length;
    for (const link of links) this.drawLink(context, link, time, toX, toY);
    this.drawEdges(context, time, toX, toY);
    const names = this.scene.spacecraft().map((craft, index) => this.drawCraft(context, craft, index, time, toX, toY));
    writeNames(context, names, width, height);
  }

  // The side of the Earth on which the Sun is below the horizon.
  drawNight(context, time, toX, toY, width, height) {
    const { longitude, latitude } = this.scene.subsolar(time);
    const turn = Math.PI / 180;
    const tilt = Math.abs(latitude) < 0.05 ? 0.05 * Math.sign(latitude || 1) : latitude;
    context.fillStyle = NIGHT;
    context.beginPath();
    const dark = tilt > 0 ? height : 0; // the pole where it is night
    context.moveTo(0, dark);
    for (let degrees = -180; degrees <= 180; degrees += 2) {
      const edge = Math.atan(-Math.cos((degrees - longitude) * turn) / Math.tan(tilt * turn)) / turn;
      context.lineTo(toX(degrees), toY(edge));
    }
    context.lineTo(width, dark);
    context.fill();
  }

  drawDipEquator(context, toX, toY) {
    context.strokeStyle = "rgba(255, 255, 255, .7)";
    context.setLineDash([6, 5]);
    context.lineWidth = 1.2;
    context.beginPath();
    for (const [longitude, latitude] of this.scene.dipEquator) context.lineTo(toX(longitude), toY(latitude));
    context.stroke();
    context.setLineDash([]);
  }

  drawEdges(context, time, toX, toY) {
    context.strokeStyle = REGION;
    context.lineWidth = 2;
    for (const series of this.scene.ofKind("boundary")) {
      series.time.forEach((at, index) => {
        if (at > time) return;
        const [x, y] = [toX(series.columns.longitude_deg[index]), toY(series.columns.latitude_deg[index])];
        context.beginPath();
        context.arc(x, y, 4, 0, 2 * Math.PI);
        context.stroke();
      });
    }
  }

  drawGrid(context, toX, toY, width, height) {
    context.strokeStyle = "rgba(160, 185, 205, .3)";
    context.fillStyle = "#d5e0ea";
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.lineWidth = 1;
    const buttons = document.getElementById("camera")?.offsetLeft || width;
    const step = width / 12 < LABEL_ROOM ? 60 : 30;
    for (let longitude = -150; longitude < 180; longitude += 30) {
      segment(context, toX(longitude), 0, toX(longitude), height);
      if (longitude % step || toX(longitude) + LABEL_ROOM > buttons) continue;
      context.fillText(`${Math.abs(longitude)}°${longitude < 0 ? "W" : longitude ? "E" : ""}`,
        toX(longitude) + 3, 12);
    }
    for (let latitude = -60; latitude < 90; latitude += 30) {
      segment(context, 0, toY(latitude), width, toY(latitude));
      context.fillText(`${Math.abs(latitude)}°${latitude < 0 ? "S" : latitude ? "N" : ""}`,
        3, toY(latitude) - 3);
    }
  }

  drawLink(context, link, time, toX, toY) {
    const [from, to] = [geodetic(link.from), geodetic(link.to)];
    const value = this.scene.linkValue(link, time, this.quantity);
    context.strokeStyle = value === null ? "#8a929b" : css(cividis(partOf(value, this.colourRange)));
    context.lineWidth = 1.2;
    // The short way round.
    const turn = ((to.longitude - from.longitude + 540) % 360) - 180;
    for (const shift of [0, 360, -360]) {
      segment(context, toX(from.longitude + shift), toY(from.latitude),
        toX(from.longitude + turn + shift), toY(to.latitude));
    }
    context.fillStyle = "#e8eef3";
    context.font = "10px system-ui, sans-serif";
    const x = toX(to.longitude);
    context.fillRect(x - 2, toY(to.latitude) - 2, 4, 4);
    const right = x + context.measureText(link.satellite).width + 8 < context.canvas.clientWidth; // else it would be cut off
    context.textAlign = right ? "left" : "right";
    context.fillText(link.satellite, x + (right ? 4 : -4), toY(to.latitude) + 3);
    context.textAlign = "left";
  }

  // Draw a spacecraft with its ground track; return where its name belongs.
  drawCraft(context, craft, index, time, toX, toY) {
    const orbit = this.scene.orbit(craft);
    const colour = craftColour(index);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.setLineDash(index ? [6, 4] : []);
    context.beginPath();
    let before = null;
    for (let i = 0; i < orbit.time.length; i += Math.max(1, Math.floor(orbit.time.length / 1000))) {
      const place = geodetic([orbit.columns.x[i], orbit.columns.y[i], orbit.columns.z[i]]);
      const jumps = before !== null && Math.abs(place.longitude - before) > 180;
      if (before === null || jumps) context.moveTo(toX(place.longitude), toY(place.latitude));
      else context.lineTo(toX(place.longitude), toY(place.latitude));
      before = place.longitude;
    }
    context.stroke();
    context.setLineDash([]);
    const now = geodetic(orbit.positionAt(time));
    context.fillStyle = colour;
    context.beginPath();
    const [x, y] = [toX(now.longitude), toY(now.latitude)];
    context.arc(x, y, Math.max(6 - index, 3), 0, 2 * Math.PI);
    context.fill();
    return { name: craft, colour, x, y, below: index > 0 };
  }
}

// Write names beside their points, outlined, none over another or beyond the edge.
function writeNames(context, names, width, height) {
  context.font = "600 13px system-ui, sans-serif";
  context.textAlign = "left";
  context.strokeStyle = "#10161d";
  context.lineWidth = 3;
  const wished = names.map(({ name, x, y, below }) => {
    const wide = context.measureText(name).width;
    return { left: x + wide + 13 < width ? x + 9 : x - wide - 9, top: below ? y + 6 : y - 22, wide, high: 16 };
  });
  placeLabels(wished, width, height).forEach(({ left, top }, index) => {
    context.fillStyle = names[index].colour;
    context.strokeText(names[index].name, left, top + 13);
    context.fillText(names[index].name, left, top + 13);
  });
}

function segment(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}
