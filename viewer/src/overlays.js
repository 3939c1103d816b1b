// What lies over a map: costs on the floors, routes, the voxels of fields, grasps.

import * as THREE from "three";
import { MARK } from "./house.js";

const HUES = 0.61803; // of a turn between two sets of voxels: all differ
const FINGER = 0.05; // metres

export class Overlays {
  constructor(house) {
    this.house = house;
    this.costs = new THREE.Group(); // planes on the floors
    this.lines = new THREE.Group(); // routes
    this.voxels = new THREE.Group(); // a mesh for each set
    this.grasps = new THREE.Group();
    const named = { costs: this.costs, routes: this.lines, fields: this.voxels, grasps: this.grasps };
    this.groups = Object.entries(named).map(([name, group]) => Object.assign(group, { name }));
  }

  // Put all where their storeys are, if they are shown; `userData` has storey or level of each.
  arrange() {
    const { house } = this;
    if (!house.scene) return;
    for (const group of this.groups) {
      for (const each of group.children) {
        const { storey, level } = each.userData;
        const on = house.scene.storeys.find(({ name }) => name === storey) ?? house.storeyAt(level);
        each.position.z = (each.userData.z ?? 0) + (on ? house.lift(on) : 0);
        each.visible = !house.hidden.has(group.name) && !house.hidden.has(on?.name);
      }
    }
    house.stage.draw();
  }

  fill(group, objects) {
    group.traverse((each) => {
      each.material?.map?.dispose();
      each.material?.dispose();
      each.geometry?.dispose();
    });
    group.clear();
    if (objects.length) group.add(...objects);
    this.arrange();
  }

  // Lay pictures of costs on the floors of storeys, those of a robot's parts at their heights.
  async drawCosts(layers) {
    const images = await Promise.all(layers.map(({ png }) => picture(png)));
    const planes = layers.map(({ storey, level, low, high, height = 0.04 }, number) => {
      const texture = new THREE.Texture(images[number]);
      Object.assign(texture, { magFilter: THREE.NearestFilter, colorSpace: THREE.SRGBColorSpace, needsUpdate: true });
      const plane = new THREE.Mesh(
        new THREE.PlaneGeometry(high[0] - low[0], high[1] - low[1]),
        new THREE.MeshBasicMaterial({ map: texture, transparent: true, depthWrite: false, side: THREE.DoubleSide }),
      );
      plane.position.set((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0);
      plane.userData = { storey, level, z: level + height };
      return plane;
    });
    this.fill(this.costs, planes);
  }

  // Draw ways, a list of points (x, y, z) each; they are seen through walls.
  drawWays(ways) {
    const tubes = [];
    for (const points of ways) {
      const curve = new THREE.CurvePath();
      for (let i = 1; i < points.length; i++) {
        curve.add(new THREE.LineCurve3(lifted(points[i - 1]), lifted(points[i])));
      }
      if (!curve.curves.length) continue;
      const tube = new THREE.TubeGeometry(curve, 8 * points.length, 0.06, 6);
      const way = new THREE.Mesh(tube, new THREE.MeshBasicMaterial({ color: MARK, depthTest: false }));
      way.renderOrder = 1;
      way.userData.level = points[0][2];
      tubes.push(way);
    }
    this.fill(this.lines, tubes);
  }

  // Draw the cubes of sets of voxels, each set of a storey in a colour of its own.
  drawVoxels(sets, size) {
    const cube = new THREE.BoxGeometry(size, size, size);
    const meshes = sets.flatMap(({ of, centres }, number) => {
      const colour = new THREE.Color().setHSL((0.92 + number * HUES) % 1, 0.65, 0.55);
      const by = Map.groupBy(centres, ([, , z]) => this.house.storeyAt(z));
      return [...by].map(([storey, there]) => {
        const material = new THREE.MeshLambertMaterial({ color: colour, transparent: true, opacity: 0.8 });
        const mesh = new THREE.InstancedMesh(cube, material, there.length);
        const matrix = new THREE.Matrix4();
        there.forEach((centre, i) => mesh.setMatrixAt(i, matrix.makeTranslation(...centre)));
        mesh.name = of;
        mesh.userData = { storey: storey?.name, level: there[0][2] };
        return mesh;
      });
    });
    this.fill(this.voxels, meshes);
  }

  // Draw grasps as forks of two fingers, the likelier the greener: they move along z, and close along x.
  drawGrasps(found) {
    const forks = found.map(({ pose, width, expected }) => {
      const half = (width ?? 0.05) / 2;
      const corners = [[0, 0, -2], [0, 0, -1], [-half, 0, -1], [-half, 0, 0], [-half, 0, -1], [half, 0, -1], [half, 0, 0]];
      const line = new THREE.Line(
        new THREE.BufferGeometry().setFromPoints(corners.map(([x, y, z]) => new THREE.Vector3(x, y, z * FINGER))),
        new THREE.LineBasicMaterial({ color: new THREE.Color().setHSL(0.33 * (expected ?? 0.5), 0.8, 0.45) }),
      );
      line.position.set(...pose.slice(0, 3));
      line.quaternion.set(...pose.slice(3));
      line.userData = { level: pose[2], z: pose[2] };
      return line;
    });
    this.fill(this.grasps, forks);
  }
}

function picture(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  return createImageBitmap(new Blob([bytes], { type: "image/png" }), { imageOrientation: "flipY" });
}

function lifted([x, y, z]) {
  return new THREE.Vector3(x, y, z + 0.1);
}
