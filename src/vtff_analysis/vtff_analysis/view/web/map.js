// Map of the ground tracks on a plain canvas: what is shown where Cesium is not installed.

import { CN0_RANGE, REGION, cividis, craftColour, css, partOf } from "./colours.js";
import { prepare } from "./canvas.js";
import { Scene, geodetic } from "./scene.js";

export class GroundMap {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.linkCount = 0;
    canvas.hidden = false;
  }

  update() {}

  look() {}

  get counts() {
    return { spacecraft: this.scene.spacecraft().length, links: this.linkCount };
  }

  draw(time) {
    const { context, width, height } = prepare(this.canvas);
    const toX = (longitude) => ((longitude + 180) / 360) * width;
    const toY = (latitude) => ((90 - latitude) / 180) * height;
    context.fillStyle = "#10202e";
    context.fillRect(0, 0, width, height);
    this.drawGrid(context, toX, toY, width, height);
    for (const region of this.scene.regions) {
      context.fillStyle = "rgba(204, 121, 167, .35)";
      context.strokeStyle = REGION;
      const west = Scene.westOf(region, time);
      const box = [toX(west), toY(region.latitude_north_deg), (region.width_deg / 360) * width,
        toY(region.latitude_south_deg) - toY(region.latitude_north_deg)];
      context.fillRect(...box);
      context.strokeRect(...box);
    }
    const links = this.scene.linksAt(time);
    this.linkCount = links.length;
    for (const link of links) this.drawLink(context, link, toX, toY);
    this.scene.spacecraft().forEach((craft, index) => {
      this.drawCraft(context, craft, index, time, toX, toY);
    });
  }

  drawGrid(context, toX, toY, width, height) {
    context.strokeStyle = "#2b4256";
    context.fillStyle = "#93a8ba";
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.lineWidth = 1;
    for (let longitude = -150; longitude < 180; longitude += 30) {
      segment(context, toX(longitude), 0, toX(longitude), height);
      context.fillText(`${Math.abs(longitude)}°${longitude < 0 ? "W" : longitude ? "E" : ""}`,
        toX(longitude) + 3, 12);
    }
    for (let latitude = -60; latitude < 90; latitude += 30) {
      segment(context, 0, toY(latitude), width, toY(latitude));
      context.fillText(`${Math.abs(latitude)}°${latitude < 0 ? "S" : latitude ? "N" : ""}`,
        3, toY(latitude) - 3);
    }
  }

  drawLink(context, link, toX, toY) {
    const [from, to] = [geodetic(link.from), geodetic(link.to)];
    context.strokeStyle = css(cividis(partOf(link.cn0, CN0_RANGE)));
    context.lineWidth = 1.2;
    // The short way round.
    const turn = ((to.longitude - from.longitude + 540) % 360) - 180;
    for (const shift of [0, 360, -360]) {
      segment(context, toX(from.longitude + shift), toY(from.latitude),
        toX(from.longitude + turn + shift), toY(to.latitude));
    }
    context.fillStyle = "#e8eef3";
    context.font = "10px system-ui, sans-serif";
    context.fillRect(toX(to.longitude) - 2, toY(to.latitude) - 2, 4, 4);
    context.fillText(link.satellite, toX(to.longitude) + 4, toY(to.latitude) + 3);
  }

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
    context.arc(toX(now.longitude), toY(now.latitude), 6 - index, 0, 2 * Math.PI);
    context.fill();
    context.font = "13px system-ui, sans-serif";
    context.fillText(craft, toX(now.longitude) + 9, toY(now.latitude) + (index ? 18 : -8));
  }
}

function segment(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}
