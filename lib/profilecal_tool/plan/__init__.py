"""Before anything is measured: which poses or sweeps, how many, and what covariance a
calibration will then state.

    SPEC.toml ─ specification ─┐
                               ├─ knowledge ─► ScanModel ─ candidates ─► possible poses
    scan folder ─ calibrate ───┘                               │
                                             Plan ◄─ design ◄──┘ (sweeps: along them)

A prediction is the calibration's own linear model of what a perfect scanner would see
(`scan_model`). `task` goes from files to a plan and its folder, `words` says it.

Poses R (P, 3, 3), T (P, 3), mm, are as the joint solution has them: eye-to-hand, of the
base in the flange's frame. Boxes, zones and files are about the flange in the base.
"""
