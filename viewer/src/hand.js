// The hand of a user who may change the map: drags what is selected, and takes changes back.

import * as THREE from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";

export class Hand {
  // `change` carries out an operation with its values.
  constructor(stage, house, change) {
    this.house = house;
    this.change = change;
    this.done = [];
    this.point = new THREE.Object3D();
    this.gizmo = new TransformControls(stage.camera, stage.canvas);
    this.gizmo.setSize(0.7);
    stage.scene.add(this.point, this.gizmo.getHelper());
    this.gizmo.addEventListener("change", () => stage.draw());
    this.gizmo.addEventListener("dragging-changed", ({ value: drags }) => {
      stage.controls.enabled = !drags;
      if (!drags) this.drop();
    });
    this.gizmo.addEventListener("objectChange", () => {
      const { x, y, z } = this.point.position;
      this.entity.pose.splice(0, 3, x, y, z - this.lift);
      house.place(this.entity);
    });
  }

  // Whether a pointer is on the gizmo, so that a click is not one on the map.
  get busy() {
    return this.gizmo.axis !== null;
  }

  hold(entity) {
    this.gizmo.detach();
    this.entity = entity?.pose && entity.object && !entity.removed ? entity : null;
    if (!this.entity) return;
    const [x, y, z] = entity.pose;
    this.lift = this.house.lift(this.house.storeyOf(entity, z));
    this.point.position.set(x, y, z + this.lift);
    this.from = [x, y, z];
    this.gizmo.attach(this.point);
  }

  async drop() {
    const { name, pose } = this.entity;
    const [at, from] = [pose.slice(0, 3), this.from];
    this.from = at;
    const stays = () => this.house.entities.get(name)?.pose?.slice(0, 3).every((value, i) => Math.abs(value - at[i]) < 1e-3);
    await this.act("move_to", { entity: name, ...xyz(at) }, ["move_to", { entity: name, ...xyz(from) }], stays);
  }

  // Carry out an operation; `back` is the one that takes it back while it `stays` as it is then.
  async act(operation, values, back, stays) {
    await this.change(operation, values);
    this.done.push({ back, stays });
  }

  // Take back the last operation, unless somebody changed the same since; returns what was done.
  async undo() {
    const last = this.done.pop();
    if (!last) return "nothing to take back";
    if (!last.stays()) return `${last.back[1].entity} was changed since: it is left as it is`;
    try {
      await this.change(...last.back);
    } catch (error) {
      this.done.push(last);
      throw error;
    }
    return "taken back";
  }
}

function xyz([x, y, z]) {
  return { x, y, z };
}
