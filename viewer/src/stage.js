// Camera, light and canvas; a picture is drawn when something has changed.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { CSS2DRenderer } from "three/addons/renderers/CSS2DRenderer.js";

const DARK = matchMedia("(prefers-color-scheme: dark)");

export class Stage {
  constructor(canvas, labels, panel) {
    this.panel = panel;
    this.labels = new CSS2DRenderer({ element: labels });
    THREE.Object3D.DEFAULT_UP.set(0, 0, 1);
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(45, 1, 0.1, 5000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = Math.PI * 0.49;
    this.controls.addEventListener("change", () => this.draw());
    const sun = new THREE.DirectionalLight("#ffffff", 1.6);
    sun.position.set(-3, -5, 8);
    this.scene.add(sun, new THREE.HemisphereLight("#ffffff", "#b8b2a6", 1.5));
    DARK.addEventListener("change", () => this.paint());
    addEventListener("resize", () => this.fit());
    this.paint();
    this.fit();
  }

  paint() {
    this.scene.background = new THREE.Color(DARK.matches ? "#1d2026" : "#fbfaf7");
    this.draw();
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.renderer.setSize(width, height, false);
    this.labels.setSize(width, height);
    this.camera.aspect = width / Math.max(height, 1);
    // The middle of the picture is that of what the panel leaves free.
    const { right, top } = this.panel.getBoundingClientRect();
    const beside = right < width / 2 ? [-right / 2, 0] : [0, (height - top) / 2];
    this.camera.setViewOffset(width, height, ...beside, width, height);
    this.draw();
  }

  // `before` is called with the camera and the height of the picture.
  draw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = null;
      this.before?.(this.camera, this.canvas.clientHeight);
      this.renderer.render(this.scene, this.camera);
      this.labels.render(this.scene, this.camera);
    });
  }

  // Look at a box from the south and above, beside the panel.
  look(box) {
    if (box.isEmpty()) return;
    const middle = box.getCenter(new THREE.Vector3());
    const size = Math.max(box.getSize(new THREE.Vector3()).length(), 1);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const { right } = this.panel.getBoundingClientRect();
    const free = right < width / 2 ? width - right : width;
    const far = size * Math.max(1.15, (1.2 * height) / free);
    const away = new THREE.Vector3(0, -0.75, 1).normalize().multiplyScalar(far);
    this.camera.position.copy(middle).add(away);
    this.controls.target.copy(middle);
    this.controls.update();
    this.draw();
  }

  ray(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const x = (2 * (event.clientX - left)) / width - 1;
    const y = 1 - (2 * (event.clientY - top)) / height;
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(x, y), this.camera);
    return ray;
  }
}
