// The entities of a map as objects of three.js: rooms as floors, doors as leaves, things as meshes.

import * as THREE from "three";
import { CSS2DObject } from "three/addons/renderers/CSS2DRenderer.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { Overlays } from "./overlays.js";

export const MARK = new THREE.Color("#d6336c");
const NOWHERE = new THREE.Matrix4().makeScale(0, 0, 0);
const DOOR_HEIGHT = 2; // metres, where the map has none

export class House {
  constructor(stage) {
    this.stage = stage;
    this.group = new THREE.Group();
    this.overlays = new Overlays(this);
    stage.scene.add(this.group, ...this.overlays.groups);
    this.hidden = new Set(["ceilings"]); // names of storeys and kinds
    this.apart = 0;
    this.past = null; // the poses of another time by name
    this.marked = new Map(); // how much of the colour of a mark each name has, from 0 to 1
    this.entities = new Map();
    this.labels = [];
    stage.before = (camera, height) => this.label(camera, height);
  }

  // Show a scene of the server; `glb` has the meshes of its things.
  async show(scene, glb) {
    const made = await new GLTFLoader().parseAsync(glb, "");
    const shapes = new Map();
    made.scene.traverse((node) => node.geometry && shapes.set(Number(node.name), node));
    this.clear();
    this.scene = scene;
    this.extents = new Map(scene.storeys.map((storey) => [storey, new THREE.Box2()]));
    for (const place of scene.places) {
      this.addPlace(place);
      const corners = place.areas.flat(2).map(([x, y]) => new THREE.Vector2(x, y));
      for (const corner of corners) this.extents.get(this.storeyOf(place, place.floor))?.expandByPoint(corner);
    }
    for (const door of scene.doors) this.addDoor(door);
    const by = Map.groupBy(scene.things, (thing) => thing.mesh);
    for (const [mesh, things] of by) {
      const shape = shapes.get(mesh);
      if (shape?.isPoints) for (const thing of things) this.addThings(shape, [thing]);
      else if (shape) this.addThings(shape, things);
      else for (const thing of things) this.entities.set(thing.name, thing);
    }
    this.arrange();
  }

  clear() {
    for (const { label } of this.labels) label.removeFromParent();
    this.labels = [];
    for (const each of this.group.children) {
      each.geometry?.dispose();
      each.material?.dispose();
    }
    this.group.clear();
    this.entities.clear();
  }

  addPlace(place) {
    const shapes = place.areas.map(([outer, ...inner]) => {
      const shape = new THREE.Shape(outer.map(([x, y]) => new THREE.Vector2(x, y)));
      shape.holes = inner.map((ring) => new THREE.Path(ring.map(([x, y]) => new THREE.Vector2(x, y))));
      return shape;
    });
    const region = place.kind === "region";
    const material = new THREE.MeshLambertMaterial({
      color: place.colour,
      side: THREE.DoubleSide,
      transparent: region,
      opacity: region ? 0.4 : 1,
    });
    const floor = new THREE.Mesh(new THREE.ShapeGeometry(shapes), material);
    const corners = place.areas.flatMap((rings) => rings.flatMap(segments));
    const edge = new THREE.LineSegments(
      new THREE.BufferGeometry().setFromPoints(corners.map(([x, y]) => new THREE.Vector3(x, y, 0.01))),
      new THREE.LineBasicMaterial({ color: "#7d8087" }),
    );
    floor.add(edge);
    if (!region && corners.length) this.name(place, floor);
    this.keep(place, floor, place.floor + (region ? 0.03 : 0.015)); // above a floor of the same height
  }

  name(place, floor) {
    const label = new CSS2DObject(document.createElement("div"));
    label.element.textContent = place.name;
    floor.geometry.computeBoundingBox();
    const size = floor.geometry.boundingBox.getSize(new THREE.Vector3());
    floor.geometry.boundingBox.getCenter(label.position);
    floor.add(label);
    this.labels.push({ label, place, wide: size.x });
  }

  // Show the names of rooms that are wide enough in the picture, and behind no other storey.
  label(camera, height) {
    const scale = height / (2 * Math.tan(((camera.fov / 2) * Math.PI) / 180));
    const at = new THREE.Vector3();
    const storeys = this.scene?.storeys.filter((storey) => !this.hidden.has(storey.name)) ?? [];
    for (const { label, place, wide } of this.labels) {
      const pixels = (wide * scale) / camera.position.distanceTo(label.getWorldPosition(at));
      const own = this.storeyOf(place, place.level);
      const covered = storeys.some((storey) => storey !== own && this.isBetween(storey, camera.position, at));
      label.visible = !covered && label.parent.visible && pixels > 6 * place.name.length;
    }
  }

  // Whether the floor of a storey is between two points.
  isBetween(storey, a, b) {
    const level = storey.elevation + this.lift(storey);
    const share = (level - a.z) / (b.z - a.z);
    const at = new THREE.Vector3().lerpVectors(a, b, share);
    return share > 0 && share < 1 && this.extents.get(storey)?.containsPoint(new THREE.Vector2(at.x, at.y));
  }

  addDoor(door) {
    const [[x0, y0], [x1, y1]] = [door.line[0], door.line.at(-1)];
    const width = Math.max(Math.hypot(x1 - x0, y1 - y0), 0.1);
    const height = door.type === "opening" ? 0.05 : (door.height ?? DOOR_HEIGHT);
    const leaf = new THREE.Mesh(
      new THREE.BoxGeometry(width, 0.06, height).translate(0, 0, height / 2),
      new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.55 }),
    );
    leaf.position.set((x0 + x1) / 2, (y0 + y1) / 2, 0);
    leaf.rotation.z = Math.atan2(y1 - y0, x1 - x0);
    this.keep(door, leaf, door.floor);
    this.colour(door);
  }

  keep(entity, object, level) {
    object.userData.names = [entity.name];
    this.group.add(object);
    this.entities.set(entity.name, Object.assign(entity, { object, level }));
  }

  addThings(shape, things) {
    const points = shape.isPoints;
    const material = points
      ? new THREE.PointsMaterial({ size: 0.03, color: "#707a86" })
      : new THREE.MeshLambertMaterial({ side: THREE.DoubleSide, flatShading: true });
    const object = points
      ? new THREE.Points(shape.geometry, material)
      : new THREE.InstancedMesh(shape.geometry, material, things.length);
    object.matrixAutoUpdate = !points;
    object.userData.names = things.map((thing) => thing.name);
    this.group.add(object);
    things.forEach((thing, number) => {
      this.entities.set(thing.name, Object.assign(thing, { object, number }));
      this.colour(thing);
    });
  }

  colour(entity) {
    const state = this.scene.states[entity.state];
    const colour = new THREE.Color(state ?? entity.colour ?? "#8f8a82");
    const share = this.marked.get(entity.name) ?? 0;
    colour.lerp(MARK, entity.kind === "room" ? share / 2 : share); // floors are large
    if (entity.object?.isInstancedMesh) {
      entity.object.setColorAt(entity.number, colour);
      entity.object.instanceColor.needsUpdate = true;
    } else if (entity.object) entity.object.material.color.copy(colour);
  }

  // The storey whose floor is the highest one below a height.
  storeyAt(z) {
    return this.scene.storeys.findLast((storey) => storey.elevation <= z + 0.3) ?? this.scene.storeys[0];
  }

  // The storey of an entity as the map has it, until it is moved.
  storeyOf(entity, z) {
    return this.scene.storeys.find((storey) => storey.name === entity.storey) ?? this.storeyAt(z);
  }

  lift(storey) {
    return this.apart * Math.max(this.scene.storeys.indexOf(storey), 0);
  }

  isShown(entity, storey) {
    if (entity.removed || this.hidden.has(storey?.name)) return false;
    return !this.hidden.has(entity.overhead ? "ceilings" : LAYERS[entity.kind] ?? "things");
  }

  // Put an entity where it is: on its storey, apart from the others, if it is shown.
  place(entity) {
    const pose = this.past && entity.level === undefined ? this.past[entity.name] : entity.pose;
    const z = pose ? pose[2] : entity.level;
    const storey = this.past && pose ? this.storeyAt(z) : this.storeyOf(entity, z);
    const lift = this.lift(storey);
    const shown = this.isShown(entity, storey) && (pose || entity.level !== undefined);
    if (!entity.object) return;
    if (entity.level !== undefined) {
      entity.object.visible = shown;
      entity.object.position.z = entity.level + lift;
      return;
    }
    const [x, y, height, ...turn] = pose ?? [0, 0, 0, 0, 0, 0, 1];
    const matrix = new THREE.Matrix4().compose(
      new THREE.Vector3(x, y, height + lift),
      new THREE.Quaternion(...turn),
      new THREE.Vector3(1, 1, 1),
    );
    if (!entity.object.isInstancedMesh) {
      entity.object.visible = shown;
      entity.object.matrix.copy(matrix);
      return;
    }
    entity.object.setMatrixAt(entity.number, shown ? matrix : NOWHERE);
    entity.object.instanceMatrix.needsUpdate = true;
    entity.object.boundingSphere = null; // so that rays meet it where it is
  }

  arrange() {
    for (const entity of this.entities.values()) this.place(entity);
    this.overlays.arrange();
    this.stage.draw();
  }

  // Take over an event; false if the scene has to be read again.
  hear(event) {
    const [former, renamed] = event.values?.name ?? [];
    if (renamed && this.entities.has(former)) {
      this.entities.set(renamed, Object.assign(this.entities.get(former), { name: renamed }));
      this.entities.delete(former);
    }
    const entity = this.entities.get(event.name);
    const flat = entity && entity.level !== undefined;
    if (event.what === "moved" && entity && !flat) {
      entity.pose = Object.values(event.to_pose);
      entity.holder = event.to_holder;
      entity.storey = null; // that of its height
      this.place(entity);
    } else if (event.what === "state" && entity) {
      entity.state = event.values.state[1];
      this.colour(entity);
    } else if (event.what === "removed" && entity) {
      entity.removed = true;
      this.place(entity);
    } else if (DRAWN.has(event.what)) return false;
    this.stage.draw();
    return true;
  }

  // Mark names, or what a map from names gives a share.
  mark(names) {
    const marked = names instanceof Map ? names : new Map(names.map((name) => [name, 1]));
    const changed = new Set([...this.marked.keys(), ...marked.keys()]);
    this.marked = marked;
    for (const name of changed) if (this.entities.has(name)) this.colour(this.entities.get(name));
    this.stage.draw();
  }

  // The name of what a ray meets first.
  met(ray) {
    const [first] = ray.intersectObjects(this.group.children.filter((each) => each.visible), false);
    return first && first.object.userData.names[first.instanceId ?? 0];
  }

  box(names) {
    const box = new THREE.Box3();
    for (const name of names ?? this.entities.keys()) {
      const entity = this.entities.get(name);
      if (!entity?.object || (!names && entity.overhead)) continue;
      const own = new THREE.Box3();
      if (entity.object.isInstancedMesh) {
        const matrix = new THREE.Matrix4();
        entity.object.getMatrixAt(entity.number, matrix);
        entity.object.geometry.boundingBox ?? entity.object.geometry.computeBoundingBox();
        own.copy(entity.object.geometry.boundingBox).applyMatrix4(matrix);
      } else own.setFromObject(entity.object);
      if (names || entity.kind === "room") box.union(own);
    }
    if (!names && !box.isEmpty()) box.max.z += DOOR_HEIGHT;
    return box.isEmpty() && !names ? new THREE.Box3().setFromObject(this.group) : box;
  }

  // Show where things were; null: where they are.
  goTo(past) {
    this.past = past;
    this.arrange();
  }
}

export const LAYERS = { room: "rooms", region: "regions", connector: "doors", object: "things", agent: "agents" };
const DRAWN = new Set(["added", "moved", "changed", "reshaped", "removed"]);

function segments(ring) {
  return ring.slice(1).flatMap((point, i) => [ring[i], point]);
}
